//! Tables as text: Markdown, CSV, LaTeX.

use super::grid::{Block, Cell, Head};
use crate::args::TableFormat;

/// Where there is no number.
const NONE: &str = "–";

/// All tables, and below them why they should not be trusted, where the format has a place for it.
pub(super) fn text(format: TableFormat, blocks: &[Block], doubts: &[String]) -> String {
    match format {
        TableFormat::Markdown => markdown(blocks, doubts),
        TableFormat::Csv => csv(blocks),
        TableFormat::Latex => latex(blocks, doubts),
    }
}

fn markdown(blocks: &[Block], doubts: &[String]) -> String {
    let table = |block: &Block| {
        let title = block.title.as_ref().map_or(String::new(), |head| format!("{}\n\n", plain_head(head)));
        let heads: Vec<String> = block.heads.iter().map(plain_head).collect();
        let rule = core::iter::once("---").chain(block.heads.iter().skip(1).map(|_| "---:"));
        let rows = block.rows.iter().map(|(label, cells)| {
            let cells = cells.iter().map(|cell| of_cell(cell.as_ref(), |text| format!("**{text}**")));
            line(core::iter::once(escaped_for_markdown(label)).chain(cells))
        });
        format!("{title}{}{}{}", line(heads), line(rule.map(str::to_owned)), rows.collect::<String>())
    };
    let doubts = doubts.iter().map(|doubt| format!("{doubt}\n"));
    blocks.iter().map(table).chain(doubts).collect::<Vec<_>>().join("\n")
}

fn line(cells: impl IntoIterator<Item = String>) -> String {
    format!("| {} |\n", cells.into_iter().collect::<Vec<_>>().join(" | "))
}

fn escaped_for_markdown(text: &str) -> String {
    text.replace('|', "\\|")
}

/// Words, unit and which way is better.
fn plain_head(head: &Head) -> String {
    let arrow = head.more_is_better.map_or("", |more| if more { "↑" } else { "↓" });
    let words = [escaped_for_markdown(&head.words), head.unit.to_owned(), arrow.to_owned()];
    words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

fn of_cell(cell: Option<&Cell>, bold: impl Fn(&str) -> String) -> String {
    match cell {
        None => NONE.to_owned(),
        Some(Cell { text, is_best: true, .. }) => bold(text),
        Some(Cell { text, .. }) => text.clone(),
    }
}

/// Numbers in full, for other programs. Of several scenes the first column says what is shown.
fn csv(blocks: &[Block]) -> String {
    let name = |head: &Head| {
        let unit = if head.unit.is_empty() { String::new() } else { format!(" {}", head.unit) };
        quoted(&format!("{}{unit}", head.words))
    };
    let table = |(index, block): (usize, &Block)| {
        let first = |words: &str| block.title.as_ref().map(|_| words.to_owned());
        let title = block.title.as_ref().map(name).unwrap_or_default();
        let heads = first("quantity").into_iter().chain(block.heads.iter().map(name)).collect::<Vec<_>>().join(",");
        let rows = block.rows.iter().map(|(label, cells)| {
            let numbers = cells.iter().map(|cell| cell.as_ref().map_or(String::new(), |cell| cell.value.to_string()));
            let all: Vec<String> = first(&title).into_iter().chain([quoted(label)]).chain(numbers).collect();
            format!("{}\n", all.join(","))
        });
        let heads = if index == 0 { format!("{heads}\n") } else { String::new() };
        format!("{heads}{}", rows.collect::<String>())
    };
    blocks.iter().enumerate().map(table).collect()
}

/// RFC 4180.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// One `tabular`, which needs no package; doubts are comments in front of it.
fn latex(blocks: &[Block], doubts: &[String]) -> String {
    let Some(first) = blocks.first() else { return String::new() };
    let doubts: String = doubts.iter().map(|doubt| format!("% {doubt}\n")).collect();
    let columns = "r".repeat(first.heads.len() - 1);
    let heads = latex_line(first.heads.iter().map(latex_head));
    let table = |block: &Block| {
        let span = block.heads.len();
        let title = block.title.as_ref().map(latex_head);
        let title = title.map_or(String::new(), |title| format!("\\multicolumn{{{span}}}{{l}}{{{title}}} \\\\\n"));
        let rows = block.rows.iter().map(|(label, cells)| {
            let cells = cells.iter().map(|cell| {
                of_cell(cell.as_ref(), |text| format!("\\textbf{{{text}}}")).replace(NONE, "--").replace(' ', "\\,")
            });
            latex_line(core::iter::once(escaped_for_latex(label)).chain(cells))
        });
        format!("{title}{}\\hline\n", rows.collect::<String>())
    };
    let tables: String = blocks.iter().map(table).collect();
    format!("{doubts}\\begin{{tabular}}{{l{columns}}}\n\\hline\n{heads}\\hline\n{tables}\\end{{tabular}}\n")
}

fn latex_line(cells: impl Iterator<Item = String>) -> String {
    format!("{} \\\\\n", cells.collect::<Vec<_>>().join(" & "))
}

fn latex_head(head: &Head) -> String {
    let arrow = head.more_is_better.map_or("", |more| if more { "$\\uparrow$" } else { "$\\downarrow$" });
    let unit = head.unit.replace('°', "$^\\circ$");
    let words = [escaped_for_latex(&head.words), unit, arrow.to_owned()];
    words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

fn escaped_for_latex(text: &str) -> String {
    let escaped = |letter: char| match letter {
        '\\' => "\\textbackslash{}".to_owned(),
        '~' => "\\textasciitilde{}".to_owned(),
        '^' => "\\textasciicircum{}".to_owned(),
        '&' | '%' | '$' | '#' | '_' | '{' | '}' => format!("\\{letter}"),
        other => other.to_string(),
    };
    text.chars().map(escaped).collect()
}
