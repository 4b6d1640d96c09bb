//! `query --backend gpu` against the same query on the CPU: every quantity, an exact and an approximate rig.

use std::collections::HashMap;

use assert_cmd::Command;

use crate::on_gpu;

const SCENE: &str = "schema_version = 1\ntitle = \"ball\"\n[[object]]\nname = \"ball\"\nreceiver = true\n\
    transform = { rotate = [20, 30, 0], translate = [9, 1, -4] }\nshape = { sphere = { center = [0, 0, 0], radius = 0.4 } }\n";
const LIGHTS: &str = "schema_version = 1\n\
    [[light]]\nname = \"a\"\nsphere = { center = [9, 3, -4], radius = 0.5, radiance = [3, 2, 1] }\n\
    [[light]]\nname = \"b\"\ndisk = { center = [7, 1, -4], normal = [1, 0, 0], radius = 0.5, radiance = [1, 2, 3] }\n";
const POINTS: &str = "x,y,z,nx,ny,nz\n9.1,1.2,-4.1,0,1,0\n8.8,0.9,-3.9,-1,0.5,0.2\n9,1,-4,0,0,1\n";

/// Rows as words, in the folder of the three files above.
fn answer(folder: &std::path::Path, arguments: &[&str]) -> Vec<HashMap<String, String>> {
    let mut command = Command::cargo_bin("rigbench").expect("cargo builds the binary for its tests");
    let fixed = ["query", "./ball.toml", "--lights", "./lights.toml", "--points", "points.csv"];
    let output = command.current_dir(folder).args(fixed).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    csv::Reader::from_reader(&output.stdout[..]).deserialize().map(|row| row.unwrap()).collect()
}

/// The largest difference of a channel, over the largest value.
fn disagreement(a: &[HashMap<String, String>], b: &[HashMap<String, String>]) -> f64 {
    assert!(a.len() == b.len() && !a.is_empty());
    let value = |row: &HashMap<String, String>, channel: &str| row[channel].parse::<f64>().unwrap();
    let channels = || ["r", "g", "b"].into_iter();
    let largest = a.iter().flat_map(|row| channels().map(|c| value(row, c).abs())).fold(0.0, f64::max);
    let pairs = a.iter().zip(b).flat_map(|(a, b)| channels().map(move |c| (value(a, c) - value(b, c)).abs()));
    pairs.fold(0.0, f64::max) / largest
}

#[test]
fn a_query_on_the_gpu_gives_every_quantity() {
    on_gpu("a_query_on_the_gpu_gives_every_quantity", |_| {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("ball.toml", SCENE), ("lights.toml", LIGHTS), ("points.csv", POINTS)] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let rigs = ["gradient = {}", "mixed = { x = { lattice = 3 }, y = \"constant\", z = \"gradient\" }"];
        for rig in rigs {
            for (quantity, tolerance) in [("irradiance", 1e-5), ("sh", 1e-5), ("sh-gradient", 2e-3)] {
                for order in ["1", "3", "6"] {
                    let asked = ["--rig", rig, "--quantity", quantity, "--order", order];
                    let cpu = answer(folder.path(), &asked);
                    let gpu = answer(folder.path(), &[&asked[..], &["--backend", "gpu"]].concat());
                    let off = disagreement(&cpu, &gpu);
                    assert!(off < tolerance, "{rig}, {quantity}, order {order}: {off:e}");
                    assert!(
                        cpu.iter().zip(&gpu).all(|(a, b)| a.get("i") == b.get("i") && a.get("axis") == b.get("axis"))
                    );
                    // and the other rig is another answer
                    if quantity == "sh" && order == "3" {
                        let other = answer(folder.path(), &["--rig", rigs[0], "--quantity", "sh", "--order", "3"]);
                        assert!(rig == rigs[0] || disagreement(&other, &gpu) > 1e-3);
                    }
                }
            }
        }
    });
}

#[test]
fn a_query_of_a_volume_on_the_gpu_is_that_of_the_cpu() {
    on_gpu("a_query_of_a_volume_on_the_gpu_is_that_of_the_cpu", |_| {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("ball.toml", SCENE), ("lights.toml", LIGHTS), ("points.csv", POINTS)] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let bounds = "bounds = { min = [8.2, 0.3, -4.8], max = [9.7, 1.8, -3.3] }";
        for rig in [
            format!("grid = {{ {bounds}, samples = [4, 3, 4], interpolation = \"half_gradient\" }}"),
            format!("octree = {{ {bounds}, min_level = 1, max_level = 3, interpolation = \"tricubic\" }}"),
        ] {
            for (quantity, tolerance) in [("irradiance", 2e-5), ("sh", 2e-5), ("sh-gradient", 5e-3)] {
                let asked = ["--rig", &rig, "--quantity", quantity, "--order", "3"];
                let cpu = answer(folder.path(), &asked);
                let gpu = answer(folder.path(), &[&asked[..], &["--backend", "gpu"]].concat());
                let off = disagreement(&cpu, &gpu);
                assert!(off < tolerance && off > 0.0, "{rig}, {quantity}: {off:e}");
            }
        }
    });
}
