//! Writes Parquet files, for sweeps and exports. Equal rows give equal bytes.

use std::io::{self, Write};

use arrow_array::{ArrayRef, RecordBatch};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;

/// Maximum number of rows of a row group, which is held in memory while a file is written.
pub(crate) const ROWS_PER_GROUP: usize = 65_536;

/// Rows with columns of these names, which are of one length.
pub fn batch(columns: Vec<(&str, ArrayRef)>) -> RecordBatch {
    let columns = columns.into_iter().map(|(name, column)| (name, column, true));
    RecordBatch::try_from_iter_with_nullable(columns).expect("columns of one length")
}

/// Starts a file for rows with the columns of `like`.
pub fn begin<W: Write + Send>(writer: W, like: &RecordBatch) -> io::Result<ArrowWriter<W>> {
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_max_row_group_row_count(Some(ROWS_PER_GROUP))
        .build();
    ArrowWriter::try_new(writer, like.schema(), Some(properties)).map_err(io::Error::other)
}

/// The bytes of a file with these columns.
pub fn parquet(columns: Vec<(&str, ArrayRef)>) -> Vec<u8> {
    let batch = batch(columns);
    let mut file = begin(Vec::new(), &batch).expect("plain types");
    file.write(&batch).and_then(|()| file.into_inner()).expect("memory takes everything")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use arrow_array::{Array, Float64Array};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    fn column(values: impl Iterator<Item = Option<f64>>) -> Vec<(&'static str, ArrayRef)> {
        vec![("x", Arc::new(values.collect::<Float64Array>()) as ArrayRef)]
    }

    #[test]
    fn a_large_file_has_row_groups_and_reads_back() {
        let mut file = begin(tempfile::tempfile().unwrap(), &batch(column([].into_iter()))).unwrap();
        for part in 0..3 {
            let rows = (0..ROWS_PER_GROUP - part).map(|row| (row % 3 > 0).then_some((row + part) as f64));
            file.write(&batch(column(rows))).unwrap();
        }
        let read = ParquetRecordBatchReaderBuilder::try_new(file.into_inner().unwrap()).unwrap();
        assert_eq!(read.metadata().num_row_groups(), 3);
        let batches = read.with_batch_size(4 * ROWS_PER_GROUP).build().unwrap();
        let values: Vec<_> = batches.map(|batch| batch.unwrap().column(0).clone()).collect();
        assert_eq!(values.iter().map(|values| values.len()).sum::<usize>(), 3 * ROWS_PER_GROUP - 3);
        let first: &Float64Array = values[0].as_any().downcast_ref().unwrap();
        assert!(first.is_null(0) && first.value(1) == 1.0 && first.value(ROWS_PER_GROUP + 1) == 2.0);
    }
}
