//! A small experiment on volumes, as a reader meets it: its figures and its report.

use super::{folder, rigbench};

/// A ball that goes through a room with a block in it, under a lamp; volumes of three kinds, and two rigs around the ball for a strip.
pub fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    write(
        "scenes/room.toml",
        "schema_version = 1\ntitle = \"room\"\n[camera]\neye = [0, 1.3, 3.6]\ntarget = [0, 0.7, 0]\nup = [0, 1, 0]\nfov_y = 35.0\n\
         [animation]\nframes = 3\n[material.wall]\nalbedo = [0.6, 0.6, 0.6]\n[material.red]\nalbedo = [0.7, 0.1, 0.1]\n\
         [[object]]\nname = \"floor\"\nmaterial = \"wall\"\nshape = { quad = { center = [0, 0, 0], u = [1.5, 0, 0], v = [0, 0, -1.5] } }\n\
         [[object]]\nname = \"back\"\nmaterial = \"wall\"\nshape = { quad = { center = [0, 1, -1.5], u = [1.5, 0, 0], v = [0, 1, 0] } }\n\
         [[object]]\nname = \"block\"\nmaterial = \"red\"\nshape = { box = { min = [-0.3, 0, -0.9], max = [0.3, 1.2, -0.5] } }\n\
         [[object]]\nname = \"ball\"\nreceiver = true\nmaterial = \"wall\"\nshape = { sphere = { center = [0, 0.7, 0.2], radius = 0.25 } }\n\
         path = { points = [[-0.8, 0, 0], [0.8, 0, 0]] }\n\
         [[receiver]]\nname = \"volume\"\nbounds = { min = [-1.4, 0.05, -1.4], max = [1.4, 1.9, 1.4] }\n",
    );
    for (name, place) in [("lamp", "[-0.9, 1.7, -0.9]"), ("side", "[1.2, 1, 1]")] {
        let sphere = format!("sphere = {{ center = {place}, radius = 0.15, radiance = [30, 24, 18] }}");
        write(
            &format!("scenes/lights/{name}.toml"),
            &format!("schema_version = 1\n[[light]]\nname = \"a\"\n{sphere}\n"),
        );
    }
    write(
        "experiments/volumes.toml",
        "schema_version = 1\nname = \"volumes\"\ntitle = \"Which volume is worth it?\"\n[image]\nwidth = 96\nheight = 54\nkeep = \"all\"\n\
         [reference]\npoints = 32\nrelative_error = 0.1\nseconds = 600\n[effects]\nmode = \"shadows\"\n[timing]\nwarmup = 0\nrepeat = 3\nonly = { lights = \"lamp\" }\n\
         [matrix]\nscene = [\"room\"]\nlights = [\"lamp\", \"side\"]\n\
         rig = [\"grid-2\", \"grid-3\", \"popping\", \"tree\", \"two-level\", \"a-one\", \"d-eight\"]\nheuristic = [\"fine\", \"coarse\"]\nprobe_source = [\"fixed\"]\n\
         [probe_source.fixed]\ntraced = { spp = 64 }\n[heuristic.fine]\nerror = { threshold = 0.1 }\n[heuristic.coarse]\nerror = { threshold = 0.5 }\n\
         [rig.grid-2]\ngrid = { bounds = \"volume\", samples = [2, 2, 2] }\n[rig.grid-3]\ngrid = { bounds = \"volume\", samples = [3, 3, 3] }\n\
         [rig.popping]\ngrid = { bounds = \"volume\", samples = [3, 3, 3], interpolation = \"nearest\" }\n\
         [rig.tree]\noctree = { bounds = \"volume\", min_level = 1, max_level = 3 }\n\
         [rig.two-level]\ntwo_level = { bounds = \"volume\", samples = [3, 3, 3], inner = 3 }\n\
         [rig.a-one]\nconstant = {}\n[rig.d-eight]\nlattice = { samples = [2, 2, 2] }\n\
         [[exclude]]\nlights = \"lamp\"\nrig = [\"a-one\", \"d-eight\"]\n\
         [[exclude]]\nlights = \"side\"\nrig = [\"grid-2\", \"grid-3\", \"popping\", \"tree\", \"two-level\"]\n",
    );
    let (exit, _, log) = rigbench(folder.path(), &["run", "experiments/volumes.toml"]);
    assert_eq!(exit, 0, "{log}");
    folder
}
