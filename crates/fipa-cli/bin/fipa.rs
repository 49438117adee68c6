//! The command line tool.

fn main() -> std::process::ExitCode {
    fipa_cli::main()
}
