//! The page of each command in docs/commands is what the command says of itself; `scripts/pages`
//! writes them again.

use assert_cmd::Command;
use std::{env, fs, path::PathBuf};

/// Environment variable that writes the pages instead of comparing them.
const WRITES: &str = "SPECULA_WRITE_PAGES";

pub(crate) fn help(words: &[&str]) -> String {
    let mut specula = Command::cargo_bin("specula").unwrap();
    // Lines are as long as where nobody is at a terminal.
    let output = specula.args(words).arg("--help").env_remove("COLUMNS").output().unwrap();
    assert!(output.status.success(), "{words:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// Names and first words of all commands, as the program lists them.
pub(crate) fn commands() -> Vec<(String, String)> {
    let help = help(&[]);
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let mut commands: Vec<(String, String)> = Vec::new();
    for line in listed {
        match line.strip_prefix("  ").and_then(|line| line.split_once(' ')) {
            Some((name, about)) if !name.is_empty() => commands.push((name.to_owned(), about.trim().to_owned())),
            // A line more of the one before.
            _ => {
                let (_, about) = commands.last_mut().expect("a command has a name");
                *about = format!("{about} {}", line.trim());
            }
        }
    }
    commands.retain(|(name, _)| name != "help");
    commands
}

fn pages() -> Vec<(String, String)> {
    let commands = commands();
    let page = |title: &str, help: &str| format!("# {title}\n\n```text\n{}\n```\n", help.trim_end());
    let list: String = commands.iter().map(|(name, about)| format!("* [{name}]({name}.md): {about}\n")).collect();
    let first = format!("{}\n{list}", page("specula", &help(&[])));
    let settings = format!("\n## Settings\n\n```text\n{}\n```\n", help(&["train", "--set", "help"]).trim_end());
    let others = commands.iter().map(|(name, _)| {
        let more = if name == "train" { &settings[..] } else { "" };
        (format!("{name}.md"), page(&format!("specula {name}"), &help(&[name])) + more)
    });
    [("README.md".to_owned(), first)].into_iter().chain(others).collect()
}

#[test]
fn every_command_has_its_page_and_every_page_is_true() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/commands");
    let pages = pages();
    assert!(pages.len() > 5, "{pages:?}");
    if env::var_os(WRITES).is_some() {
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        pages.iter().for_each(|(name, page)| fs::write(folder.join(name), page).unwrap());
    }
    for (name, page) in &pages {
        let written = fs::read_to_string(folder.join(name)).unwrap_or_default();
        assert!(written == *page, "docs/commands/{name} is not what the program says; run scripts/pages");
    }
    let files = fs::read_dir(&folder).unwrap().count();
    assert_eq!(files, pages.len(), "docs/commands has a page of no command; run scripts/pages");
}
