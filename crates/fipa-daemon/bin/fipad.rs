//! The daemon: one per robot.

fn main() -> std::process::ExitCode {
    fipa_daemon::main()
}
