//! Layered OpenEXR images: read back exactly, the same bytes each time, and read by the OpenEXR project's own tools.

use std::path::Path;
use std::process::Command;

use rigbench::picture::{LayeredImage, Picture};

fn image() -> LayeredImage {
    let reference = Picture::from_fn(37, 21, |x, y| [0.1 * x as f32, 0.2 * y as f32, if x < 5 { 0.0 } else { 1e4 }]);
    let candidate = reference.map(|p| [p[0] * 1.1, p[1] - 0.3, p[2]]);
    let albedo = Picture::from_fn(37, 21, |x, _| if x > 30 { [0.0; 3] } else { [0.7, 0.2, 0.2] });
    LayeredImage::of_run(
        &candidate,
        &reference,
        Some(&albedo),
        "0123456789ab",
        r#"{"rig":"mixed","scene":"car","title":"Lampe über dem Wagen"}"#,
    )
}

#[test]
fn reads_back_exactly_and_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("images/0123456789ab.exr");
    let written = image();
    written.write(&path).unwrap();
    let read = LayeredImage::read(&path).unwrap();
    for (name, picture) in &written.layers {
        assert_eq!(read.layer(name), Some(picture), "{name}");
    }
    assert_eq!(read.layers.len(), 5);
    assert_eq!(
        (&read.key, &read.configuration, &read.comments),
        (&written.key, &written.configuration, &written.comments)
    );
    assert_eq!(std::fs::read(&path).unwrap(), image().to_bytes().unwrap());
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "a temporary file remains");

    std::fs::write(&path, b"no image").unwrap();
    assert!(LayeredImage::read(&path).unwrap_err().to_string().contains("0123456789ab.exr"));
    let mut uneven = image();
    uneven.layers[1].1 = Picture::filled(3, 3, [0.0; 3]);
    assert!(uneven.to_bytes().is_err());
}

#[test]
fn errors_are_signed_and_finite() {
    let image = image();
    let [candidate, reference, error, relative] =
        ["candidate", "reference", "error", "relative_error"].map(|n| image.layer(n).unwrap());
    let mut negative = 0;
    for i in 0..error.pixels.len() {
        for c in 0..3 {
            let (e, r) = (error.pixels[i][c], reference.pixels[i][c]);
            assert_eq!(e, candidate.pixels[i][c] - r);
            assert!(relative.pixels[i][c].is_finite());
            negative += usize::from(e < 0.0);
            if r > 500.0 {
                assert_eq!(relative.pixels[i][c], e / r);
            }
        }
    }
    assert!(negative > 0);
    let black = Picture::filled(4, 4, [0.0; 3]);
    let dark = LayeredImage::of_run(&black, &black, None, "", "");
    assert_eq!(dark.layer("relative_error").unwrap().not_finite(), 0);
}

/// What a tool of the OpenEXR project prints about a file; `None`, said aloud, where it is not installed and nobody demanded it.
fn openexr(tool: &str, path: &Path) -> Option<String> {
    match Command::new(tool).arg(path).output() {
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(output.status.success(), "{tool}: {text}{}", String::from_utf8_lossy(&output.stderr));
            Some(text)
        }
        Err(e) => {
            assert!(
                std::env::var_os("RIGBENCH_REQUIRE_OPENEXR").is_none_or(|v| v != "1"),
                "{tool} is demanded and cannot be run: {e}"
            );
            eprintln!("skipped: {tool} is not installed (Debian: openexr)");
            None
        }
    }
}

#[test]
fn openexr_tools_read_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.exr");
    image().write(&path).unwrap();
    if let Some(header) = openexr("exrheader", &path) {
        for layer in ["candidate", "reference", "error", "relative_error", "albedo"] {
            for channel in ["R", "G", "B"] {
                assert!(
                    header.contains(&format!("{layer}.{channel}, 32-bit floating-point")),
                    "{layer}.{channel}\n{header}"
                );
            }
        }
        for line in [
            "compression (type compression): zip, multi-scanline blocks",
            "lineOrder (type lineOrder): increasing y",
            "rigbench.key (type string): \"0123456789ab\"",
            "dataWindow (type box2i): (0 0) - (36 20)",
            "Lampe über dem Wagen",
        ] {
            assert!(header.contains(line), "no `{line}` in\n{header}");
        }
        // the test can fail: what was not written is not found
        assert!(!header.contains("candidate.A"));
    }
    if let Some(info) = openexr("exrinfo", &path) {
        assert!(info.contains("'candidate.R'") && info.contains("float"), "{info}");
    }
    // and the tools do tell a broken file from a good one
    let mut bytes = image().to_bytes().unwrap();
    bytes.truncate(200);
    let broken = folder.path().join("broken.exr");
    std::fs::write(&broken, bytes).unwrap();
    if let Ok(output) = Command::new("exrheader").arg(&broken).output() {
        assert!(!output.status.success() || !String::from_utf8_lossy(&output.stdout).contains("candidate.R"));
    }
}
