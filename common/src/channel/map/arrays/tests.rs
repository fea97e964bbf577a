use std::io::Write;

use super::*;

/// NumPy's format 1 of an array.
fn npy(kind: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    let padded = format!("{header:117}\n");
    [MAGIC, &[1, 0], &(padded.len() as u16).to_le_bytes(), padded.as_bytes(), values].concat()
}

fn floats(shape: &str, values: &[f64]) -> Vec<u8> {
    npy("<f8", shape, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>())
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in arrays {
        writer.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

const STEPS: [[f64; 2]; 2] = [[0.0, 10.0], [5.0, 20.0]];

#[test]
fn arrays_and_rows_are_the_same_map() {
    // Two SNs over x = 0, 10 and y = 0, 5, 20 at one altitude: z, y, x.
    let levels = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, f64::NAN, 11.0];
    let x_m = npy("<i4", "(2,)", &[0i32, 10].map(i32::to_le_bytes).concat());
    let y_m = npy("<f4", "(3,)", &[0f32, 5.0, 20.0].map(f32::to_le_bytes).concat());
    let z_m = npy("<i8", "(1,)", &30i64.to_le_bytes());
    let [one, other] = ["snr_db", "rate_bps"].map(|name| {
        let levels = floats("(2, 1, 3, 2)", &levels);
        archive(&[("x_m", x_m.clone()), ("y_m", y_m.clone()), ("z_m", z_m.clone()), (name, levels)])
    });
    let row = |(index, level): (usize, &f64)| {
        let level = if level.is_nan() { String::new() } else { level.to_string() };
        let y_m = [0, 5, 20][index / 2 % 3];
        format!("{},{},{y_m},30,{level}\n", index / 6, index % 2 * 10)
    };
    let rows: String = levels.iter().enumerate().map(row).collect();
    let text = |level: &str| format!("sensor,x_m,y_m,z_m,{level}\n{rows}");
    let parse = |level: &str, steps| LinkMap::parse(&text(level), Path::new("a.csv"), steps).unwrap();
    assert_eq!(read(&one, Some(STEPS.to_vec())).unwrap(), parse("snr_db", Some(STEPS.to_vec())));
    assert_eq!(read(&other, None).unwrap(), parse("rate_bps", None));
    let folder = tempfile::tempdir().unwrap();
    let [path, rates] = ["a.npz", "rates.csv"].map(|name| folder.path().join(name));
    std::fs::write(&path, &one).unwrap();
    std::fs::write(&rates, "snr_db,rate_bps\n0,10\n5,20\n").unwrap();
    assert_eq!(*LinkMap::read(&path, Some(&rates)).unwrap(), read(&one, Some(STEPS.to_vec())).unwrap());
}

#[test]
fn ten_grids_are_sorted_as_those_of_a_file() {
    let levels: Vec<f64> = (0..12).map(f64::from).collect();
    let map = LinkMap::of_arrays([vec![0.0], vec![0.0], vec![20.0]], &[12, 1, 1, 1], &levels, None).unwrap();
    let (text, _) = map.to_csv();
    assert_eq!(LinkMap::parse(&text, Path::new("a.csv"), None).unwrap(), map);
}

#[test]
fn invalid_arrays_are_refused() {
    let axis = || floats("(1,)", &[0.0]);
    let with = |name: &'static str, bytes: Vec<u8>| {
        let mut arrays =
            vec![("x_m", axis()), ("y_m", axis()), ("z_m", axis()), ("rate_bps", floats("(1,1,1,1)", &[5.0]))];
        arrays.retain(|(other, _)| *other != name);
        arrays.push((name, bytes));
        archive(&arrays)
    };
    for (bytes, message) in [
        (b"PK".to_vec(), "expected arrays x_m, y_m, z_m, and snr_db or rate_bps, saved by numpy.savez"),
        (archive(&[("x_m", axis())]), "no array snr_db: expected arrays"),
        (archive(&[("rate_bps", axis()), ("y_m", axis())]), "no array x_m: expected arrays"),
        (with("snr_db", axis()), "snr_db and rate_bps: expected arrays"),
        (with("x_m", b"\x93NUMPY\x01".to_vec()), "x_m: expected an array of numbers in C order"),
        (with("x_m", npy("<c16", "(1,)", &[0; 16])), "x_m: type `<c16`: expected <f8, <f4, <i8 or <i4"),
        (with("x_m", npy("<f8", "(2,)", &[0; 8])), "x_m: shape [2]: expected as many values"),
        (with("x_m", npy("<f8", "(18446744073709551615, 2)", &[0; 8])), "expected as many values"),
        (with("x_m", floats("(2,)", &[3.0, 3.0])), "x_m: expected finite numbers that ascend, at least one"),
        (with("z_m", floats("(1,)", &[f64::NAN])), "z_m: expected finite numbers that ascend"),
        (with("rate_bps", floats("(1, 1, 1)", &[0.0])), "shape [1, 1, 1]: expected [N, 1, 1, 1], for z, y and x"),
        (with("rate_bps", floats("(0, 1, 1, 1)", &[])), "shape [0, 1, 1, 1]: expected [N, 1, 1, 1]"),
        (with("rate_bps", floats("(1, 1, 1, 1)", &[-1.0])), "rate_bps = -1: expected a rate from 0 to 1e300, or nan"),
    ] {
        let error = read(&bytes, None).unwrap_err();
        assert!(error.contains(message), "{error}");
    }
    let fortran = String::from_utf8_lossy(&axis()).replace("False", "True ");
    assert!(NumpyArray::parse(fortran.as_bytes()).is_err());
    let snrs = archive(&[("x_m", axis()), ("y_m", axis()), ("z_m", axis()), ("snr_db", floats("(1,1,1,1)", &[5.0]))]);
    assert!(read(&snrs, None).unwrap_err().contains("expected the rates of each SNR as link.rates"));
}
