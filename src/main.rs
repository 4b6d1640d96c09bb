fn main() -> std::process::ExitCode {
    rigbench::cli::main()
}
