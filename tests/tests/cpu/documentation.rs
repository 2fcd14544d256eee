//! Form of the documentation. Each relative link, image and anchor of README, ARCHITECTURE,
//! CHANGELOG and `docs` resolves, and the book's table of contents lists each page outside of
//! `docs/lab`. Comments of sources begin with a noun or a verb, and end at [`COLUMNS_MAX`].

use std::{
    collections::BTreeSet,
    fs,
    path::{Component, Path, PathBuf},
};

/// Folder of the repository.
fn root() -> PathBuf {
    normal(&Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
}

/// Path without `.` and `..`, which need not exist.
fn normal(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut path, part| {
        match part {
            Component::CurDir => {}
            Component::ParentDir => assert!(path.pop(), "a path below the root of the file system"),
            part => path.push(part),
        }
        path
    })
}

/// Pages below a folder, in order.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder of pages").map(|entry| entry.expect("an entry").path()).collect();
    entries.sort();
    entries
        .into_iter()
        .flat_map(|path| if path.is_dir() { pages(&path) } else { vec![path] })
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .collect()
}

/// Lines of Markdown without fenced code.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

/// Line without code spans.
fn without_code(line: &str) -> String {
    line.split('`').step_by(2).collect::<Vec<_>>().join(" ")
}

/// Targets of links and images, in Markdown and in HTML, in order.
fn links(text: &str) -> Vec<String> {
    // Spans of code may contain brackets; a link's text may contain code.
    let text: String = prose(text).map(|line| without_code(line) + "\n").collect();
    let ends = [("](", ')'), ("src=\"", '"'), ("href=\"", '"')];
    let target = |(start, end): (&str, char)| {
        text.split(start).skip(1).map(|rest| rest.split(end).next().unwrap_or_default().to_owned()).collect::<Vec<_>>()
    };
    ends.into_iter().flat_map(target).collect()
}

/// Anchors of the headings of a page, as GitHub and mdBook name them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for line in prose(text).filter(|line| line.starts_with('#')) {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        let anchor: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let repeated = (1..).map(|n| format!("{anchor}-{n}"));
        let free = core::iter::once(anchor.clone()).chain(repeated).find(|name| !found.contains(name));
        found.insert(free.expect("endless names"));
    }
    found
}

/// Broken links of a page: the target does not exist, has no such heading, or lies outside of the
/// folder `within`.
fn broken(page: &Path, text: &str, within: &Path) -> Vec<String> {
    let is_external = |link: &str| link.starts_with("https://") || link.starts_with("mailto:");
    let is_broken = |link: &String| {
        let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
        let target = if file.is_empty() { page.to_owned() } else { normal(&page.with_file_name("").join(file)) };
        let lacks_heading = || {
            let text = if file.is_empty() { text.to_owned() } else { fs::read_to_string(&target).unwrap_or_default() };
            !anchor.is_empty() && !anchors(&text).contains(anchor)
        };
        !target.starts_with(within) || !(file.is_empty() || target.exists()) || lacks_heading()
    };
    links(text).into_iter().filter(|link| !is_external(link)).filter(is_broken).collect()
}

#[test]
fn every_link_of_the_documentation_resolves() {
    let root = root();
    let docs = root.join("docs");
    let first = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(|name| (root.join(name), root.clone()));
    // The book holds nothing from outside of its folder.
    let book = pages(&docs).into_iter().map(|page| (page, docs.clone()));

    let mut count = 0;
    for (page, within) in first.into_iter().chain(book) {
        let text = fs::read_to_string(&page).expect("a page");
        count += links(&text).len();
        let broken = broken(&page, &text, &within);
        assert!(broken.is_empty(), "{}: broken links {broken:?}", page.display());
    }
    assert!(count > 50, "{count} links were found");
}

/// Largest number of words of README, which a reader skims.
const README_WORDS_MAX: usize = 1100;

#[test]
fn the_readme_is_short() {
    let words = fs::read_to_string(root().join("README.md")).expect("a page").split_whitespace().count();
    assert!(words <= README_WORDS_MAX, "README.md has {words} words, more than {README_WORDS_MAX}");
}

#[test]
fn the_table_of_contents_lists_each_page_once() {
    let docs = root().join("docs");
    let summary = fs::read_to_string(docs.join("SUMMARY.md")).expect("a table of contents");
    let mut listed: Vec<PathBuf> = links(&summary).iter().map(|link| docs.join(link)).collect();
    listed.sort();
    let mut written = pages(&docs);
    written.retain(|page| !page.ends_with("SUMMARY.md") && !page.starts_with(docs.join("lab")));
    assert_eq!(listed, written, "chapters of SUMMARY.md and pages of docs");
}

#[test]
fn a_broken_link_is_found() {
    let docs = root().join("docs");
    let page = docs.join("made-up.md");
    let text = "# One\n\n## Two, `x`\n\n## One\n\n[a](guide.md) [b](no-page.md) ![c](no-picture.png) [d](#one) [e](#three)\n\
                [f](guide.md#no-heading) [g](../README.md) <img src=\"gone.png\"> [h](https://example.org/x) `[i](code.md)`\n\
                ```text\n[j](fenced.md)\n```\n[`k`](#two-x) [l](#one-1) [m](#one-2)\n";
    assert_eq!(
        broken(&page, text, &docs),
        ["no-page.md", "no-picture.png", "#three", "guide.md#no-heading", "../README.md", "#one-2", "gone.png"],
        "links that lead nowhere"
    );
}

/// Largest width of a comment line, in characters.
const COLUMNS_MAX: usize = 100;

/// Words that open a clause instead of naming a thing or an action.
const CLAUSE_WORDS: [&str; 8] = ["What", "Who", "Whose", "How", "Where", "When", "Which", "And"];

/// Sources of the workspace in Rust and WGSL, below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let is_foreign = |name: &str| name.starts_with('.') || ["target", "shared", "node_modules"].contains(&name);
    let entries = fs::read_dir(folder).expect("a folder of sources").map(|entry| entry.expect("an entry").path());
    entries
        .filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(|name| !is_foreign(name)))
        .flat_map(|path| match path.is_dir() {
            true => sources(&path),
            false => vec![path],
        })
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs" || extension == "wgsl"))
        .collect()
}

/// Text of a line of a doc comment.
fn doc_text(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

/// Faults of a source's comments, each with its line: width beyond [`COLUMNS_MAX`], and doc
/// comments that begin with one of [`CLAUSE_WORDS`].
fn comment_faults(text: &str) -> Vec<(usize, String)> {
    let mut faults = Vec::new();
    let mut is_inside = false;
    for (number, line) in (1..).zip(text.lines()) {
        if line.trim_start().starts_with("//") && line.chars().count() > COLUMNS_MAX {
            faults.push((number, format!("more than {COLUMNS_MAX} columns")));
        }
        let doc = doc_text(line);
        let first = doc.and_then(|doc| doc.split(|c: char| !c.is_alphanumeric()).next());
        if let Some(word) = first.filter(|word| !is_inside && CLAUSE_WORDS.contains(word)) {
            faults.push((number, format!("begins with {word:?}")));
        }
        is_inside = doc.is_some();
    }
    faults
}

#[test]
fn comments_begin_with_a_noun_or_a_verb_and_end_at_a_hundred_columns() {
    let sources = sources(&root());
    assert!(sources.len() > 300, "{} sources were found", sources.len());
    let faults: Vec<String> = sources
        .iter()
        .flat_map(|path| {
            let text = fs::read_to_string(path).expect("a source in UTF-8");
            comment_faults(&text).into_iter().map(move |(line, fault)| format!("{}:{line}: {fault}", path.display()))
        })
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_faulty_comment_is_found() {
    let wide = "é".repeat(COLUMNS_MAX - 3);
    let text = format!(
        "//! How it works.\n\nfn f() {{}}\n// {wide}\n    // {wide}\n/// Width.\n/// Where it is used.\n#[inline]\n/// And more.\n/// \
         Whatever.\n"
    );
    let lines: Vec<usize> = comment_faults(&text).into_iter().map(|(line, _)| line).collect();
    assert_eq!(lines, [1, 5, 9]);
}
