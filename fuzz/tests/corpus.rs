//! Every input of the corpora through its check.

use std::panic::catch_unwind;
use std::path::Path;

use skysink_fuzz::TARGETS;

#[test]
fn every_input_of_the_corpora_passes_the_check_of_its_target() {
    for (target, check) in TARGETS {
        let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        let files = corpus.read_dir().expect("each target has a corpus");
        let paths: Vec<_> = files.map(|file| file.expect("the corpus can be listed").path()).collect();
        assert!((1..=40).contains(&paths.len()), "{}: {} inputs", corpus.display(), paths.len());
        for path in paths {
            let input = std::fs::read(&path).expect("the input can be read");
            assert!(input.len() <= 4096, "{}: longer than libFuzzer makes them", path.display());
            assert!(catch_unwind(|| check(&input)).is_ok(), "{} fails", path.display());
        }
    }
}
