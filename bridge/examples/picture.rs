//! Takes a picture of the page as a person sees it: `picture URL FILE.png [JAVASCRIPT]`.
//!
//! In: the address of a running bridge, a file name, and optionally an expression that sets the view through the
//! page's own hook, `window.tsense`. Out: a PNG of 1280 x 720. Needs Chromium. The README's picture is made so.
#![allow(clippy::disallowed_methods, reason = "a tool: it writes a file")]

#[path = "../tests/common/chromium.rs"]
mod chromium;

use chromium::Browser;

/// Pictures drawn before the one that is kept: the first ones lack the newest frames.
const WARM_UP: u32 = 4;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [url, file, look @ ..] = words.as_slice() else {
        eprintln!("usage: picture URL FILE.png [JAVASCRIPT]");
        std::process::exit(2);
    };
    let Some(mut browser) = Browser::open(url, 1280, 720) else { std::process::exit(1) };
    browser.wait_for("window.tsense && tsense.frameDone > 2 && tsense.counts.blocks > 0");
    for expression in look {
        browser.value(expression);
    }
    browser.wait_for(&format!("(window.until ??= tsense.frameDone + {WARM_UP}) <= tsense.frameDone"));
    std::fs::write(file, browser.picture()).expect("the file can be written");
}
