//! The README's first command.

use crate::support::DEMO;

#[test]
fn the_demo_prints_every_command_and_where_the_files_lie() {
    let said = &DEMO.said;
    for command in [
        "fixtures -- generate",
        "mapper -- build",
        "mapper -- size",
        "mapper -- draw",
        "localizer -- run",
        "localizer -- eval",
    ] {
        assert!(said.contains(&format!("$ cargo run --release --bin {command}")), "{command}: {said}");
    }
    for name in ["street.csm", "street.build.json", "street_poses.txt", "street.svg", "localized/estimates.csv"] {
        assert!(DEMO.file(name).is_file(), "{name}");
    }
}
