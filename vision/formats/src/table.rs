//! Comma-separated tables with a header line.

/// Why a table was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TableError {
    /// Not UTF-8.
    #[error("the table is not UTF-8 text")]
    NotText,
    /// No header line.
    #[error("the table is empty")]
    Empty,
    /// A column that must be there is not.
    #[error("the table has no column {column:?}")]
    MissingColumn {
        /// Its name.
        column: &'static str,
    },
    /// A column name came twice.
    #[error("the table has column {column:?} twice")]
    DuplicateColumn {
        /// Its name.
        column: String,
    },
    /// A row of another length than the header.
    #[error("line {line} has {got} fields, the header has {expected}")]
    WrongNumFields {
        /// From 1.
        line: usize,
        /// What came.
        got: usize,
        /// What the header has.
        expected: usize,
    },
    /// A field that is no finite number.
    #[error("line {line}: {column} is {value:?}, which is not a finite number")]
    NotANumber {
        /// From 1.
        line: usize,
        /// Column name.
        column: String,
        /// The field, shortened.
        value: String,
    },
    /// A field with a number out of its range.
    #[error("line {line}: {column} is {value:?}: {reason}")]
    OutOfRange {
        /// From 1.
        line: usize,
        /// Column name.
        column: String,
        /// The field.
        value: String,
        /// The rule.
        reason: &'static str,
    },
    /// An image came twice.
    #[error("line {line}: image {image:?} comes twice")]
    DuplicateImage {
        /// From 1.
        line: usize,
        /// Its name.
        image: String,
    },
}
