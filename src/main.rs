//! The program `buffon`.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    // Before anything else: nothing below may run on a CPU that lacks what it was compiled for.
    if let Some(sentence) = buffon::cli::cpu::missing_feature() {
        _ = writeln!(std::io::stderr(), "buffon: {sentence}");
        return ExitCode::from(1);
    }
    buffon::cli::main()
}
