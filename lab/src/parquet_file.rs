//! Writes Parquet files, for sweeps and exports.

use std::io::{self, Write};
use std::sync::Arc;

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;

/// Maximum number of rows of a row group, which is held in memory while a file is written.
pub(crate) const ROWS_PER_GROUP: usize = 65_536;

/// A Parquet file that is written in parts. Equal parts give equal bytes.
pub struct ParquetFile<W: Write + Send> {
    schema: Arc<Schema>,
    writer: ArrowWriter<W>,
}

impl<W: Write + Send> ParquetFile<W> {
    /// Starts a file with columns of these names and types.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn begin(writer: W, columns: &[(&str, ArrayRef)]) -> io::Result<Self> {
        let field = |(name, column): &(&str, ArrayRef)| Field::new(*name, column.data_type().clone(), true);
        let schema = Arc::new(Schema::new(columns.iter().map(field).collect::<Vec<_>>()));
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_max_row_group_row_count(Some(ROWS_PER_GROUP))
            .build();
        let writer = ArrowWriter::try_new(writer, Arc::clone(&schema), Some(properties)).map_err(io::Error::other)?;
        Ok(Self { schema, writer })
    }

    /// Adds rows to the columns given to [`ParquetFile::begin`].
    ///
    /// # Errors
    /// If the file cannot be written.
    ///
    /// # Panics
    /// If the columns have other types, or their lengths differ.
    pub fn add(&mut self, columns: Vec<(&str, ArrayRef)>) -> io::Result<()> {
        let schema = Arc::clone(&self.schema);
        let columns = columns.into_iter().map(|(_, column)| column).collect();
        let batch = RecordBatch::try_new(schema, columns).expect("columns of one length and the schema's types");
        self.writer.write(&batch).map_err(io::Error::other)
    }

    /// Completes the file and returns the writer.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> io::Result<W> {
        self.writer.into_inner().map_err(io::Error::other)
    }
}

/// The bytes of a Parquet file with these columns.
///
/// # Panics
/// If the lengths differ.
pub fn parquet(columns: Vec<(&str, ArrayRef)>) -> Vec<u8> {
    let mut file = ParquetFile::begin(Vec::new(), &columns).expect("plain types");
    file.add(columns).expect("memory takes everything");
    file.finish().expect("memory takes everything")
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::{Array, Float64Array};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    fn column(values: impl Iterator<Item = Option<f64>>) -> Vec<(&'static str, ArrayRef)> {
        vec![("x", Arc::new(values.collect::<Float64Array>()) as ArrayRef)]
    }

    #[test]
    fn a_large_file_has_row_groups_and_reads_back() {
        let mut file = ParquetFile::begin(tempfile::tempfile().unwrap(), &column([].into_iter())).unwrap();
        for part in 0..3 {
            let rows = (0..ROWS_PER_GROUP - part).map(|row| (row % 3 > 0).then_some((row + part) as f64));
            file.add(column(rows)).unwrap();
        }
        let read = ParquetRecordBatchReaderBuilder::try_new(file.finish().unwrap()).unwrap();
        assert_eq!(read.metadata().num_row_groups(), 3);
        let batches = read.with_batch_size(4 * ROWS_PER_GROUP).build().unwrap();
        let values: Vec<_> = batches.map(|batch| batch.unwrap().column(0).clone()).collect();
        assert_eq!(values.iter().map(|values| values.len()).sum::<usize>(), 3 * ROWS_PER_GROUP - 3);
        let first: &Float64Array = values[0].as_any().downcast_ref().unwrap();
        assert!(first.is_null(0) && first.value(1) == 1.0 && first.value(ROWS_PER_GROUP + 1) == 2.0);
    }
}
