//! Pieces of a page: text and tables.

/// Text as it is, wherever it stands in a page.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

/// A cell of a table: its text, and the class it is styled by.
pub struct Cell {
    text: String,
    class: &'static str,
}

impl Cell {
    /// Words, to the left.
    pub fn words(text: impl Into<String>) -> Self {
        Self { text: text.into(), class: "words" }
    }

    /// A figure, to the right, its digits below those of other rows.
    pub fn figure(text: impl Into<String>) -> Self {
        Self { text: text.into(), class: "figure" }
    }

    pub fn classed(self, class: &'static str) -> Self {
        Self { class, ..self }
    }
}

/// A table that scrolls by itself where the page is narrow; headings stand as their first row's cells do.
pub fn table(caption: &str, headings: &[&str], rows: &[Vec<Cell>]) -> String {
    let heading = |(i, text): (usize, &&str)| {
        let class = rows.first().and_then(|row| row.get(i)).map_or("words", |cell| cell.class);
        format!("<th class=\"{class}\">{}</th>", escape(text))
    };
    let headings: String = headings.iter().enumerate().map(heading).collect();
    let body: String = rows.iter().map(|row| format!("<tr>{}</tr>\n", cells(row))).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table><caption>{}</caption>\n<thead><tr>{headings}</tr></thead>\n\
         <tbody>\n{body}</tbody></table></div>\n",
        escape(caption)
    )
}

fn cells(row: &[Cell]) -> String {
    row.iter()
        .map(|cell| format!("<td class=\"{}\">{}</td>", cell.class, escape(&cell.text)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_becomes_markup() {
        assert_eq!(escape("a<b & \"c\" > 'd'"), "a&lt;b &amp; &quot;c&quot; &gt; &#39;d&#39;");
        let cells = vec![Cell::words("<script>"), Cell::figure("1 & 2")];
        let html = table("<caption>", &["a>b", "c"], &[cells]);
        assert!(
            !html.contains("<script>")
                && html.contains("&lt;script&gt;")
                && html.contains("1 &amp; 2")
        );
        assert!(html.contains("<caption>&lt;caption&gt;</caption>"));
        assert!(html.contains("<th class=\"figure\">c</th>"));
    }
}
