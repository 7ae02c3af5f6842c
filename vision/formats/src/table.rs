//! Comma-separated tables with a header line. Fields hold no commas and no quotes.

use std::collections::BTreeSet;

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

/// A table read whole; columns are found by name.
pub(crate) struct Table<'a> {
    columns: Vec<&'a str>,
    rows: Vec<Row<'a>>,
}

/// One line after the header.
pub(crate) struct Row<'a> {
    /// From 1, the header included.
    line: usize,
    fields: Vec<&'a str>,
}

/// Position of a column and its name.
#[derive(Clone, Copy)]
pub(crate) struct Column {
    index: usize,
    name: &'static str,
}

impl<'a> Table<'a> {
    /// Blank lines and lines that begin with `#` are skipped.
    pub(crate) fn parse(bytes: &'a [u8]) -> Result<Self, TableError> {
        let text = std::str::from_utf8(bytes).map_err(|_| TableError::NotText)?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text
            .lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let (_, header) = lines.next().ok_or(TableError::Empty)?;
        let columns: Vec<&str> = header.split(',').map(str::trim).collect();
        for (index, column) in columns.iter().enumerate() {
            if columns[..index].contains(column) {
                return Err(TableError::DuplicateColumn { column: shorten(column) });
            }
        }
        let mut rows = Vec::new();
        for (line, text) in lines {
            let fields: Vec<&str> = text.split(',').map(str::trim).collect();
            if fields.len() != columns.len() {
                let (got, expected) = (fields.len(), columns.len());
                return Err(TableError::WrongNumFields { line, got, expected });
            }
            rows.push(Row { line, fields });
        }
        Ok(Self { columns, rows })
    }

    pub(crate) fn rows(&self) -> &[Row<'a>] {
        &self.rows
    }

    pub(crate) fn column(&self, name: &'static str) -> Option<Column> {
        let index = self.columns.iter().position(|column| *column == name)?;
        Some(Column { index, name })
    }

    pub(crate) fn required(&self, name: &'static str) -> Result<Column, TableError> {
        self.column(name).ok_or(TableError::MissingColumn { column: name })
    }

    /// The names in the column `image`: each once, none empty.
    pub(crate) fn image_names(&self) -> Result<Vec<String>, TableError> {
        let column = self.required("image")?;
        let mut seen = BTreeSet::new();
        for row in &self.rows {
            let image = row.fields[column.index];
            if image.is_empty() {
                return Err(row.out_of_range(column, "an image needs a name"));
            }
            if !seen.insert(image) {
                return Err(TableError::DuplicateImage { line: row.line, image: shorten(image) });
            }
        }
        Ok(self.rows.iter().map(|row| row.fields[column.index].to_owned()).collect())
    }
}

impl Row<'_> {
    /// A finite number.
    pub(crate) fn number(&self, column: Column) -> Result<f64, TableError> {
        let field = self.fields[column.index];
        match field.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(TableError::NotANumber {
                line: self.line,
                column: column.name.to_owned(),
                value: shorten(field),
            }),
        }
    }

    /// A finite number, or `None` for an absent column or an empty field.
    pub(crate) fn optional(&self, column: Option<Column>) -> Result<Option<f64>, TableError> {
        match column {
            Some(column) if !self.fields[column.index].is_empty() => self.number(column).map(Some),
            _ => Ok(None),
        }
    }

    pub(crate) fn out_of_range(&self, column: Column, reason: &'static str) -> TableError {
        TableError::OutOfRange {
            line: self.line,
            column: column.name.to_owned(),
            value: shorten(self.fields[column.index]),
            reason,
        }
    }
}

/// Strangers' text, short enough for a message.
fn shorten(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_line_and_column() {
        let parse = |text: &str| Table::parse(text.as_bytes()).err();
        assert_eq!(parse(""), Some(TableError::Empty));
        assert_eq!(parse("a,a\n"), Some(TableError::DuplicateColumn { column: "a".into() }));
        assert_eq!(
            parse("a,b\n\n1\n"),
            Some(TableError::WrongNumFields { line: 3, got: 1, expected: 2 })
        );
        assert_eq!(Table::parse(b"\xff\xfe").err(), Some(TableError::NotText));
        let table = Table::parse(b"a\nnan\n").unwrap();
        let error = table.rows()[0].number(table.required("a").unwrap()).unwrap_err();
        assert_eq!(error.to_string(), "line 2: a is \"nan\", which is not a finite number");
    }

    /// Spreadsheets write a byte order mark, carriage returns and spaces.
    #[test]
    fn spreadsheet_habits_are_understood() {
        let table = Table::parse("\u{feff}image , v\r\n x.jpg , 1.5\r\n".as_bytes()).unwrap();
        assert_eq!(table.image_names().unwrap(), ["x.jpg"]);
        assert_eq!(table.rows()[0].optional(table.column("v")), Ok(Some(1.5)));
        assert_eq!(table.rows()[0].optional(table.column("w")), Ok(None));
    }

    #[test]
    fn an_image_comes_once() {
        let table = Table::parse(b"image\na\nb\na\n").unwrap();
        let image = "a".into();
        assert_eq!(table.image_names(), Err(TableError::DuplicateImage { line: 4, image }));
    }
}
