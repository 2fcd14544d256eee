//! Tables as Markdown, CSV or LaTeX.

use crate::comparison::table::{Cell, Head, Table};
use specula_scene::text::printable;

/// Text of a missing number.
const MISSING: &str = "–";

/// Format of a table's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Markdown table; the best of each column is bold.
    Markdown,
    /// Comma-separated values (RFC 4180) with every digit.
    Csv,
    /// LaTeX `tabular`; the best of each column is bold.
    Latex,
}

/// Tables as text, with warnings where the format has a place for them.
pub(super) fn text(format: Format, tables: &[Table], warnings: &[String]) -> String {
    let warnings: Vec<String> = warnings.iter().map(|warning| printable(warning)).collect();
    match format {
        Format::Markdown => markdown(tables, &warnings),
        Format::Csv => csv(tables),
        Format::Latex => latex(tables, &warnings),
    }
}

fn markdown(tables: &[Table], warnings: &[String]) -> String {
    let markdown_of = |table: &Table| {
        let title = table.title.as_ref().map_or(String::new(), |head| format!("{}\n\n", markdown_head(head)));
        let heads: Vec<String> = table.heads.iter().map(markdown_head).collect();
        let rule = core::iter::once("---").chain(table.heads.iter().skip(1).map(|_| "---:"));
        let rows = table.rows.iter().map(|(label, cells)| {
            let cells = cells.iter().map(|cell| cell_text(cell.as_ref(), |text| format!("**{text}**")));
            markdown_line(core::iter::once(escaped_for_markdown(label)).chain(cells))
        });
        format!("{title}{}{}{}", markdown_line(heads), markdown_line(rule.map(str::to_owned)), rows.collect::<String>())
    };
    let warnings = warnings.iter().map(|warning| format!("{warning}\n"));
    tables.iter().map(markdown_of).chain(warnings).collect::<Vec<_>>().join("\n")
}

fn markdown_line(cells: impl IntoIterator<Item = String>) -> String {
    format!("| {} |\n", cells.into_iter().collect::<Vec<_>>().join(" | "))
}

fn escaped_for_markdown(text: &str) -> String {
    printable(text).replace('|', "\\|")
}

/// Label, unit, and an arrow towards better values.
fn markdown_head(head: &Head) -> String {
    let arrow = head.higher_is_better.map_or("", |higher| if higher { "↑" } else { "↓" });
    let parts = [escaped_for_markdown(&head.label), head.unit.to_owned(), arrow.to_owned()];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

fn cell_text(cell: Option<&Cell>, bold: impl Fn(&str) -> String) -> String {
    match cell {
        None => MISSING.to_owned(),
        Some(Cell { text, is_best: true, .. }) => bold(text),
        Some(Cell { text, .. }) => text.clone(),
    }
}

/// Numbers with every digit. For several scenes the first column names the quantity.
fn csv(tables: &[Table]) -> String {
    let name = |head: &Head| {
        let unit = if head.unit.is_empty() { String::new() } else { format!(" {}", head.unit) };
        quoted(&format!("{}{unit}", head.label))
    };
    let csv_of = |(index, table): (usize, &Table)| {
        let first = |text: &str| table.title.as_ref().map(|_| text.to_owned());
        let title = table.title.as_ref().map(name).unwrap_or_default();
        let heads = first("quantity").into_iter().chain(table.heads.iter().map(name)).collect::<Vec<_>>().join(",");
        let rows = table.rows.iter().map(|(label, cells)| {
            let numbers = cells.iter().map(|cell| cell.as_ref().map_or(String::new(), |cell| cell.value.to_string()));
            let all: Vec<String> = first(&title).into_iter().chain([quoted(label)]).chain(numbers).collect();
            format!("{}\n", all.join(","))
        });
        let heads = if index == 0 { format!("{heads}\n") } else { String::new() };
        format!("{heads}{}", rows.collect::<String>())
    };
    tables.iter().enumerate().map(csv_of).collect()
}

/// Field of CSV (RFC 4180).
fn quoted(text: &str) -> String {
    let text = printable(text);
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// One `tabular`, which needs no package, after warnings as comments.
fn latex(tables: &[Table], warnings: &[String]) -> String {
    let Some(first) = tables.first() else { return String::new() };
    let warnings: String = warnings.iter().map(|warning| format!("% {warning}\n")).collect();
    let columns = "r".repeat(first.heads.len() - 1);
    let heads = latex_line(first.heads.iter().map(latex_head));
    let latex_of = |table: &Table| {
        let span = table.heads.len();
        let title = table.title.as_ref().map(latex_head);
        let title = title.map_or(String::new(), |title| format!("\\multicolumn{{{span}}}{{l}}{{{title}}} \\\\\n"));
        let rows = table.rows.iter().map(|(label, cells)| {
            let cells = cells.iter().map(|cell| {
                cell_text(cell.as_ref(), |text| format!("\\textbf{{{text}}}"))
                    .replace(MISSING, "--")
                    .replace(' ', "\\,")
            });
            latex_line(core::iter::once(escaped_for_latex(label)).chain(cells))
        });
        format!("{title}{}\\hline\n", rows.collect::<String>())
    };
    let tables: String = tables.iter().map(latex_of).collect();
    format!("{warnings}\\begin{{tabular}}{{l{columns}}}\n\\hline\n{heads}\\hline\n{tables}\\end{{tabular}}\n")
}

fn latex_line(cells: impl Iterator<Item = String>) -> String {
    format!("{} \\\\\n", cells.collect::<Vec<_>>().join(" & "))
}

fn latex_head(head: &Head) -> String {
    let arrow = head.higher_is_better.map_or("", |higher| if higher { "$\\uparrow$" } else { "$\\downarrow$" });
    let unit = head.unit.replace('°', "$^\\circ$");
    let parts = [escaped_for_latex(&head.label), unit, arrow.to_owned()];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

fn escaped_for_latex(text: &str) -> String {
    let escaped = |letter: char| match letter {
        '\\' => "\\textbackslash{}".to_owned(),
        '~' => "\\textasciitilde{}".to_owned(),
        '^' => "\\textasciicircum{}".to_owned(),
        '&' | '%' | '$' | '#' | '_' | '{' | '}' => format!("\\{letter}"),
        other => other.to_string(),
    };
    printable(text).chars().map(escaped).collect()
}
