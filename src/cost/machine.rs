use std::collections::BTreeMap;

/// The processor's name as the system gives it; timings belong to it.
pub fn processor_name() -> String {
    let named = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    named.unwrap_or_else(|| format!("unnamed {}", std::env::consts::ARCH))
}

/// Versions that provenance records: the program's and the git revision of the folder it runs in, where there is one.
pub fn software_versions() -> BTreeMap<String, String> {
    let mut versions = BTreeMap::from([
        ("rigbench".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("system".to_owned(), format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)),
    ]);
    let revision = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output();
    if let Ok(output) = revision
        && output.status.success()
    {
        versions.insert("git_revision".to_owned(), String::from_utf8_lossy(&output.stdout).trim().to_owned());
    }
    versions
}
