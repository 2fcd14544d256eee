//! `specula compare`: a table of what runs came to, as papers have them.

mod format;
mod grid;
mod label;
mod run;

use crate::{
    args::{Compare, TableFormat},
    failure::Failure,
    output,
};
use grid::{Quantity, blocks};
use run::Run;

/// Reads what every run says of itself, and prints or writes the table.
pub(crate) fn run(args: &Compare) -> Result<(), Failure> {
    let format = format_of(args)?;
    let runs: Vec<Run> = args.runs.iter().map(|folder| Run::read(folder)).collect::<Result<_, _>>()?;
    if runs.iter().all(|run| run.measured.iter().all(Option::is_none)) {
        let first = args.runs[0].display();
        return Err(Failure::Input(format!("none of the runs was measured; run specula eval {first}, and so on")));
    }
    let lacks = Quantity::ALL.iter().flat_map(|quantity| quantity.lacks(&runs)).collect::<Vec<String>>();
    let doubts = grid::doubts(&runs);
    lacks.iter().chain(&doubts).for_each(|note| tracing::warn!("{note}"));

    let text = format::text(format, &blocks(&runs, &label::labels(&runs)), &doubts);
    match &args.output {
        Some(path) => output::write_text(path, &text),
        None => output::say(text.trim_end()),
    }
}

/// The format that was asked for, or that of the file's ending.
fn format_of(args: &Compare) -> Result<TableFormat, Failure> {
    match (args.format, &args.output) {
        (Some(format), _) => Ok(format),
        (None, None) => Ok(TableFormat::Markdown),
        (None, Some(path)) => match output::ending(path).as_deref() {
            Some("md" | "markdown") => Ok(TableFormat::Markdown),
            Some("csv") => Ok(TableFormat::Csv),
            Some("tex") => Ok(TableFormat::Latex),
            _ => Err(Failure::Input(format!("{path:?} does not say its format; let it end in .md, .csv or .tex"))),
        },
    }
}
