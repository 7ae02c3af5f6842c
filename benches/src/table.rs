//! Tables in Markdown, which read well in a terminal too.

/// A table with a title.
#[derive(Debug, Clone, Default)]
pub(crate) struct Table {
    title: String,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table with its column heads.
    pub(crate) fn new(title: &str, heads: &[&str]) -> Self {
        Self { title: title.to_owned(), rows: vec![heads.iter().map(|&h| h.to_owned()).collect()] }
    }

    /// Adds a row.
    pub(crate) fn add(&mut self, row: Vec<String>) {
        self.rows.push(row);
    }

    /// The table as text, its columns aligned.
    pub(crate) fn to_markdown(&self) -> String {
        let num_columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |column: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..num_columns).map(width).collect();
        let line = |row: &[String]| {
            let cells = widths.iter().enumerate().map(|(column, width)| {
                let cell = row.get(column).map_or("", String::as_str);
                format!(" {cell:width$} |")
            });
            format!("|{}\n", cells.collect::<String>())
        };
        let mut text = format!("## {}\n\n{}", self.title, line(&self.rows[0]));
        let rule = widths.iter().map(|width| format!("{}|", "-".repeat(width + 2)));
        text += &format!("|{}\n", rule.collect::<String>());
        for row in &self.rows[1..] {
            text += &line(row);
        }
        text + "\n"
    }
}

/// A figure with its unit.
pub(crate) fn figure(value: f64, digits: usize, unit: &str) -> String {
    format!("{value:.digits$} {unit}").trim_end().to_owned()
}
