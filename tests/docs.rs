//! The documentation's configurations are valid: each block of TOML in it is checked by the program itself.
#![allow(clippy::disallowed_methods, reason = "a test of files reads them")]

mod harness;

use harness::{Folder, complaint, output};
use std::path::Path;

/// The blocks of TOML in a text.
fn blocks(text: &str) -> Vec<&str> {
    text.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect()
}

#[test]
fn every_configuration_in_the_documentation_is_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pages = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let pages = pages.chain([root.join("README.md")]).filter(|page| page.extension().is_some_and(|end| end == "md"));
    let (folder, mut checked) = (Folder::new("docs"), 0);
    for page in pages {
        for block in blocks(&std::fs::read_to_string(&page).unwrap()) {
            let file = folder.0.join("block.toml");
            std::fs::write(&file, block).unwrap();
            let done = output(&["config", "check", file.to_str().unwrap()]);
            assert!(done.status.success(), "{}:\n{block}\n{}", page.display(), complaint(&done));
            checked += 1;
        }
    }
    assert!(checked >= 10, "only {checked} blocks of TOML found");
}
