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
    /// LaTeX `tabular` with the rules of booktabs; the best of each column is bold.
    Latex,
}

/// Tables as text, with warnings if the format supports them.
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
        Some(Cell { text, deviation, is_best, .. }) => {
            let deviation = deviation.as_ref().map_or(String::new(), |(_, text)| format!(" ± {text}"));
            format!("{}{deviation}", if *is_best { bold(text) } else { text.clone() })
        }
    }
}

/// Numbers with every digit. For several scenes the first column names the quantity. If runs differ
/// in their seed, each column is followed by its standard deviations.
fn csv(tables: &[Table]) -> String {
    let name = |head: &Head| {
        let unit = if head.unit.is_empty() { String::new() } else { format!(" {}", head.unit) };
        quoted(&format!("{}{unit}", head.label))
    };
    let mut cells = tables.iter().flat_map(|table| &table.rows).flat_map(|(_, cells)| cells).flatten();
    let has_deviations = cells.any(|cell| cell.deviation.is_some());
    let csv_of = |(index, table): (usize, &Table)| {
        let first = |text: &str| table.title.as_ref().map(|_| text.to_owned());
        let title = table.title.as_ref().map(name).unwrap_or_default();
        let numbers_heads = table.heads[1..].iter().flat_map(|head| {
            let label = format!("{} deviation", head.label);
            let deviation = has_deviations.then(|| name(&Head { label, ..head.clone() }));
            [Some(name(head)), deviation].into_iter().flatten()
        });
        let heads = first("quantity").into_iter().chain([name(&table.heads[0])]).chain(numbers_heads);
        let heads = heads.collect::<Vec<_>>().join(",");
        let rows = table.rows.iter().map(|(label, cells)| {
            let numbers = cells.iter().flat_map(|cell| {
                let text = |number: Option<f64>| number.map_or(String::new(), |number| number.to_string());
                let value = text(cell.as_ref().map(|cell| cell.value));
                let deviation = cell.as_ref().and_then(|cell| cell.deviation.as_ref()).map(|(number, _)| *number);
                [Some(value), has_deviations.then(|| text(deviation))].into_iter().flatten()
            });
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

/// One `tabular` with the rules of booktabs, after warnings as comments.
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
                    .replace(" ± ", "$\\pm$")
                    .replace(' ', "\\,")
            });
            latex_line(core::iter::once(escaped_for_latex(label)).chain(cells))
        });
        format!("{title}{}", rows.collect::<String>())
    };
    let tables = tables.iter().map(latex_of).collect::<Vec<_>>().join("\\midrule\n");
    format!(
        "{warnings}% \\usepackage{{booktabs}}\n\\begin{{tabular}}{{l{columns}}}\n\\toprule\n{heads}\\midrule\n{tables}\
         \\bottomrule\n\\end{{tabular}}\n"
    )
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
