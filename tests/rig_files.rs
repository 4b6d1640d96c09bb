//! Rigs as files and the command line write them: what is read, and where each mistake is pointed at.

use rigbench::input::{InputError, Source};
use rigbench::rig::interpolation::{InterpolationFile, resolve_interpolation};
use rigbench::rig::{AnyRig, InterpolationChoice, Rig, RigFile, catalogue};

/// The mistake in a table that stands on the third line of a file.
fn mistake(table: &str) -> InputError {
    let source = Source::inline("experiment.toml", &format!("\n\n{table}\n"));
    let parsed = source.parse::<RigFile>();
    match parsed.and_then(|file| file.resolve(&source, 2..2 + table.len(), None)) {
        Ok(rig) => panic!("{table} is read as {rig:?}"),
        Err(error) => error,
    }
}

#[test]
fn mistakes_are_pointed_at() {
    // table, column, part of the message, help
    let cases = [
        ("", 1, "no rig; give one key of constant, gradient", None),
        ("gradiant = {}", 1, "unknown field `gradiant`", Some("`gradient`")),
        ("constant = { order = 3 }", 14, "unknown field `order`", None),
        ("constant = {}\ngradient = {}", 12, "`constant` and `gradient` in one rig", None),
        ("lattice = {}", 11, "missing field `samples`", None),
        ("lattice = { samples = [2, 2] }", 23, "2 sample counts where three belong", None),
        ("lattice = { samples = [2, 2, 2, 2] }", 23, "4 sample counts", None),
        ("lattice = { samples = [2, 0, 2] }", 27, "0 samples", None),
        ("lattice = { samples = [2, -1, 2] }", 27, "-1", None),
        ("lattice = { samples = [2, 2.5, 2] }", 27, "2.5", None),
        ("lattice = { samples = [4096, 4096, 4096] }", 23, "too many samples; at most 65536", None),
        (
            "lattice = { samples = [2, 2, 2], interpolation = \"trilineal\" }",
            50,
            "unknown interpolation",
            Some("`trilinear`"),
        ),
        ("lattice = { samples = [2, 2, 2], power = 0.0 }", 42, "a power is above 0", None),
        ("lattice = { samples = [2, 2, 2], power = nan }", 42, "no finite number", None),
        (
            "lattice = { samples = [2, 2, 2], axes = \"longest\" }",
            41,
            "unknown variant `longest`",
            Some("`longest_first`"),
        ),
        ("mixed = { x = \"constant\", y = \"constant\" }", 9, "the axis `z` is missing", None),
        ("mixed = {}", 9, "x, y, z or longest, middle, shortest", None),
        ("mixed = { x = \"constant\", y = \"constant\", shortest = \"gradient\" }", 9, "use one set of names", None),
        (
            "mixed = { x = \"constnt\", y = \"constant\", z = \"gradient\" }",
            15,
            "unknown variant `constnt`",
            Some("`constant`"),
        ),
        ("mixed = { x = {}, y = \"constant\", z = \"gradient\" }", 15, "an axis is one of", None),
        (
            "mixed = { x = { lattice = 2, hermite = 2 }, y = \"constant\", z = \"gradient\" }",
            15,
            "an axis is one of",
            None,
        ),
        ("mixed = { x = { lattice = 0 }, y = \"constant\", z = \"gradient\" }", 27, "0 samples", None),
        (
            "mixed = { x = { latice = 3 }, y = \"constant\", z = \"gradient\" }",
            17,
            "unknown field `latice`",
            Some("`lattice`"),
        ),
        ("mixed = { x = 3, y = \"constant\", z = \"gradient\" }", 15, "{ hermite = n }", None),
        ("rbf = { centers = \"corner\" }", 19, "unknown variant `corner`", Some("`corners`")),
        ("rbf = { centers = [[0, 0, 2]] }", 20, "unit box", None),
        ("rbf = { centers = [[0, 0]] }", 19, "2 numbers where three belong", None),
        ("rbf = { centers = [] }", 19, "0 centres", None),
        ("rbf = { centers = \"corners\", samples = [2, 2, 2] }", 40, "give one of them", None),
        ("rbf = { samples = [8, 8, 8] }", 19, "too many samples; at most 343", None),
        ("rbf = { kernel = \"cubical\" }", 18, "unknown variant `cubical`", Some("`cubic`")),
        ("rbf = { kernel = \"cubic\", shape = 2.0 }", 35, "only the kernel `gaussian`", None),
        ("rbf = { kernel = \"gaussian\", shape = -1.0 }", 38, "a shape is above 0", None),
    ];
    for (table, column, message, help) in cases {
        let error = mistake(table);
        assert!(error.message.contains(message), "{table}: {error}");
        let line = 3 + table[..table.len().min(14)].matches('\n').count();
        assert_eq!(error.place, Some((line, column)), "{table}: {error}");
        if let Some(help) = help {
            assert!(error.help.as_deref().is_some_and(|h| h.contains(help)), "{table}: {error}");
        }
    }
}

#[test]
fn the_matrix_replaces_the_interpolation_of_rigs_that_have_one() {
    let source = Source::inline("experiment.toml", "lattice = { samples = [2, 2, 2], power = 3.0 }");
    let file: RigFile = source.parse().unwrap();
    let resolved = |choice| file.resolve(&source, 0..1, choice).unwrap();
    let choice = |word| Some(InterpolationChoice::new(&source, 0..1, word, None).unwrap());
    assert_eq!(resolved(None).interpolation().unwrap().key(), "trilinear");
    let distance = resolved(choice("inverse_distance"));
    assert_eq!(serde_json::to_value(distance.interpolation()).unwrap()["inverse_distance"]["power"], 3.0);
    // one defined by name brings its own power
    let named = Source::inline("experiment.toml", "inverse_distance = { power = 2.0 }");
    let file_of_name: InterpolationFile = named.parse().unwrap();
    let own = resolved(Some(resolve_interpolation(&file_of_name, &named, 0..1).unwrap()));
    assert_eq!(serde_json::to_value(own.interpolation()).unwrap()["inverse_distance"]["power"], 2.0);
    // and says nothing to a rig without one
    let gradient: RigFile = Source::inline("", "gradient = {}").parse().unwrap();
    let gradient = gradient.resolve(&source, 0..1, choice("nearest")).unwrap();
    assert_eq!((gradient.key(), gradient.interpolation()), ("gradient", None));
    let wrong = InterpolationChoice::new(&source, 0..1, "trilnear", None).unwrap_err();
    assert!(wrong.help.unwrap().contains("`trilinear`"));
    for bad in ["", "nearest = {}\ntrilinear = {}", "near = {}", "nearest = { size = 1 }"] {
        let source = Source::inline("experiment.toml", bad);
        let parsed = source.parse::<InterpolationFile>();
        assert!(parsed.and_then(|file| resolve_interpolation(&file, &source, 0..0)).is_err(), "{bad:?}");
    }
}

#[test]
fn sh_vectors_are_counted_as_the_paper_counts_them() {
    for (text, vectors) in [
        ("constant = {}", 1),
        ("gradient = {}", 4),
        ("lattice = { samples = [3, 2, 2] }", 12),
        ("lattice = { samples = [8, 4, 2], axes = \"longest_first\" }", 64),
        ("lattice = { samples = [2, 2, 2], interpolation = \"half_gradient\" }", 32),
        ("mixed = { x = { lattice = 3 }, y = \"constant\", z = \"gradient\" }", 6),
        ("mixed = { longest = { lattice = 3 }, middle = \"gradient\", shortest = \"constant\" }", 6),
        ("mixed = { x = { hermite = 3 }, y = \"constant\", z = \"constant\" }", 6),
        ("rbf = { centers = \"corners+centre\", kernel = \"cubic\" }", 9),
    ] {
        let requests = AnyRig::inline(text).unwrap().placement([2.0, 1.0, 0.5]);
        assert_eq!(requests.iter().map(|r| r.vectors()).sum::<usize>(), vectors, "{text}");
    }
    // by length: the eight samples go along the longest axis
    let rig = AnyRig::inline("lattice = { samples = [8, 4, 2], axes = \"longest_first\" }").unwrap();
    let AnyRig::Lattice(lattice) = &rig else { panic!("{rig:?}") };
    assert_eq!(lattice.counts([0.5, 2.0, 1.0]), [2, 8, 4]);
}

#[test]
fn the_catalogue_holds_every_rig_interpolation_and_axis_model() {
    let entries = catalogue();
    for key in AnyRig::KEYS {
        assert!(entries.iter().any(|e| e.rig.key() == *key), "no {key} in the catalogue");
    }
    for key in rigbench::rig::Interpolation::KEYS {
        assert!(
            entries.iter().any(|e| e.rig.interpolation().is_some_and(|i| i.key() == *key)),
            "no {key} in the catalogue"
        );
    }
    for word in ["\"constant\"", "\"gradient\"", "{ lattice", "{ hermite", "thin_plate", "gaussian", "linear", "cubic"]
    {
        assert!(entries.iter().any(|e| e.text.contains(word)), "no {word} in the catalogue");
    }
}

/// Every rig's WGSL is valid beside a `tap` of its own; the GPU's tests run it.
#[test]
fn wgsl_is_valid() {
    use wgpu::naga::front::wgsl::parse_str;
    use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
    let valid = |text: &str| -> Result<(), String> {
        let shader = format!(
            "const COEFFICIENTS = 9u;\nvar<private> vectors: array<vec4f, 4096>;\nvar<private> sum: f32;\nfn tap(vector: u32, weight: f32) {{ sum += weight * f32(vector); }}\n{text}\n\
             @compute @workgroup_size(1) fn main() {{ rig_taps(vec3f(0.1, 0.2, 0.3)); }}\n"
        );
        let module = parse_str(&shader).map_err(|e| e.emit_to_string(&shader))?;
        Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).map_err(|e| e.to_string())?;
        Ok(())
    };
    for entry in catalogue() {
        for half in [[1.3, 0.5, 0.8], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1e-9, 1e9, 1.0], [1e-40, 1e-29, 1e-20]] {
            let text = entry.rig.wgsl(half);
            if let Err(error) = valid(&text) {
                panic!("{} in {half:?}: {error}", entry.text);
            }
            assert!(valid(&text.replace("rig_taps", "rig_tabs")).is_err());
        }
    }
}
