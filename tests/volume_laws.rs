//! Laws of irradiance volumes: what cells hold, what interpolation reproduces, what happens across levels, what heuristics divide.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::light::{Constant, Light, Sphere};
use rigbench::math::{Rgb, Vector3};
use rigbench::probe::{GradientSource, Prober, Probes, SampleRequest};
use rigbench::rig::{RigModel, ShVectors};
use rigbench::scene::OrientedBox;
use rigbench::sh::Window;
use rigbench::trace::{Effects, Effort, TracedGeometry, TracedMaterial, Tracer, Transport};
use rigbench::volume::{BakeError, BakedVolume, Cells, Layout, Volume, VolumeModel, bake};

fn room() -> OrientedBox {
    OrientedBox::aligned(DVec3::new(-1.0, -0.6, -0.8), DVec3::new(1.0, 0.9, 1.2))
}

/// A lamp near a corner, so that an adaptive tree is deep there, and one far away.
fn lights() -> Vec<Light<f64>> {
    let sphere = |center: [f64; 3], radius, radiance: [f64; 3]| {
        Light::Sphere(Sphere { center: Vector3::from_array(center), radius, radiance: Rgb::of(radiance) })
    };
    vec![sphere([1.2, 1.05, 1.4], 0.2, [9.0, 6.0, 3.0]), sphere([-4.0, 1.0, 0.5], 0.8, [1.0, 2.0, 4.0])]
}

fn surroundings(radiance: [f64; 3]) -> Light<f64> {
    Light::Constant(Constant { radiance: Rgb::of(radiance) })
}

fn prober<'a>(lights: &'a [Light<f64>], transport: Option<&'a Transport<'a>>, probes: Probes) -> Prober<'a> {
    let gradients = GradientSource::Analytic;
    Prober { bounds: room(), order: 3, lights, transport, probes, gradients, window: Window::None }
}

fn baked(table: &str) -> BakedVolume {
    let lights = lights();
    bake(&Volume::inline(table).unwrap(), &prober(&lights, None, Probes::Analytic)).unwrap()
}

fn cells(volume: &BakedVolume) -> &Cells {
    match &volume.layout {
        Layout::Cells(cells) => cells,
        Layout::Grid(_) => panic!("a grid has no cells"),
    }
}

const BOX: &str = "bounds = { min = [-1, -0.6, -0.8], max = [1, 0.9, 1.2] }";

fn octree(rest: &str) -> String {
    format!("octree = {{ {BOX}, min_level = 1, max_level = 4, heuristic = \"gradient\", {rest} }}")
}

fn value(volume: &BakedVolume, vectors: &ShVectors<f64>, q: DVec3) -> Vec<f64> {
    let mut sum = vec![0.0; vectors.stride()];
    volume.model::<f64>().taps(Vector3::of(q), &mut |vector, weight| {
        sum.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += weight * v);
    });
    sum
}

/// Places all over the box, none of them special.
fn places(count: usize, half: [f64; 3]) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |k| {
        let share = [0.754_877_666, 0.569_840_291, 0.413_309_47].map(|step: f64| 2.0 * (step * k as f64).fract() - 1.0);
        DVec3::new(share[0] * half[0], share[1] * half[1], share[2] * half[2])
    })
}

/// The volume with the samples of the field f and its derivatives in place of its own.
fn filled(mut volume: BakedVolume, f: impl Fn(DVec3) -> f64, gradient: impl Fn(DVec3) -> DVec3) -> BakedVolume {
    let stride = volume.values.stride();
    for (index, place) in volume.places.clone().into_iter().enumerate() {
        let place = DVec3::from_array(place);
        volume.values.data[index * stride..(index + 1) * stride].fill(f(place));
        if let Some(slopes) = &mut volume.slopes {
            for axis in 0..3 {
                let row = 3 * index + axis;
                slopes.data[row * stride..(row + 1) * stride].fill(gradient(place)[axis]);
            }
        }
    }
    volume
}

#[test]
fn an_octree_is_balanced_over_faces_edges_and_corners_and_fills_its_box() {
    let volume = baked(&octree("interpolation = \"trilinear\""));
    let cells = cells(&volume);
    let levels: std::collections::BTreeSet<u32> = cells.cells.iter().map(|c| c.size).collect();
    assert!(levels.len() >= 3, "the lamp makes the tree adaptive: sizes {levels:?}");
    let units: u64 = cells.cells.iter().map(|c| u64::from(c.size).pow(3)).sum();
    assert_eq!(units, cells.resolution.iter().map(|n| u64::from(*n)).product::<u64>());
    for a in &cells.cells {
        for b in &cells.cells {
            let touch = (0..3).all(|i| a.low[i] <= b.low[i] + b.size && b.low[i] <= a.low[i] + a.size);
            assert!(!touch || (a.size <= 2 * b.size && b.size <= 2 * a.size), "{a:?} touches {b:?}");
        }
    }
    // samples are shared by position
    let distinct: std::collections::HashSet<_> = cells.places.iter().collect();
    assert_eq!(distinct.len(), cells.places.len());
    assert!(cells.places.len() < 8 * cells.cells.len());
    // and every place is found in the cell that holds it
    for (index, cell) in cells.cells.iter().enumerate() {
        assert_eq!(cells.locate(cell.low), index);
        assert_eq!(cells.locate(cell.low.map(|u| u + cell.size - 1)), index);
    }
}

#[test]
fn nothing_jumps_across_any_face_of_a_continuous_volume() {
    for interpolation in ["trilinear", "gradient_corrected", "half_gradient", "tricubic"] {
        let with =
            |across: &str| baked(&octree(&format!("interpolation = \"{interpolation}\", across = \"{across}\"")));
        let jump = with("continuous").face_jump().unwrap();
        assert!(jump.all < 1e-12, "{interpolation}: {jump:?}");
        let naive = with("naive").face_jump().unwrap();
        assert!(
            naive.between_levels > 1e-5,
            "{interpolation}: a naive volume jumps, and the measure sees it: {naive:?}"
        );
        assert_eq!(naive.all, naive.between_levels, "{interpolation}: only where levels meet");
    }
    let nearest = baked(&octree("interpolation = \"nearest\", across = \"naive\"")).face_jump().unwrap();
    assert!(nearest.all > 1e-3);
}

/// The model itself on both sides of a face, as a renderer reads it.
#[test]
fn a_walk_over_level_boundaries_sees_no_step() {
    for (across, pops) in [("continuous", false), ("naive", true)] {
        let volume = baked(&octree(&format!("interpolation = \"half_gradient\", across = \"{across}\"")));
        let vectors = volume.vectors();
        let mean = vectors.data.iter().map(|v| v.abs()).sum::<f64>() / vectors.data.len() as f64;
        let faces: Vec<_> = cells(&volume).faces().into_iter().filter(|face| face.between_levels).collect();
        assert!(faces.len() > 20);
        let mut largest = 0.0f64;
        for face in &faces {
            let axis = (0..3).find(|a| face.low[*a] == face.high[*a]).unwrap();
            let low = DVec3::from_array(face.low);
            let q = low + (DVec3::from_array(face.high) - low) * DVec3::new(0.31, 0.47, 0.73);
            let step = DVec3::AXES[axis] * 1e-9;
            let [a, b] = [value(&volume, &vectors, q - step), value(&volume, &vectors, q + step)];
            largest = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(largest, f64::max);
        }
        assert_eq!(largest > 1e-6 * mean, pops, "{across}: {largest} of {mean}");
    }
}

#[test]
fn volumes_reproduce_what_their_interpolation_does() {
    let tables = [
        format!("grid = {{ {BOX}, samples = [4, 3, 5], interpolation = \"INTERPOLATION\" }}"),
        format!("two_level = {{ {BOX}, samples = [4, 3, 5], inner = 3, interpolation = \"INTERPOLATION\" }}"),
        octree("interpolation = \"INTERPOLATION\", across = \"naive\""),
        octree("interpolation = \"INTERPOLATION\", across = \"continuous\", roots = [2, 1, 1]"),
    ];
    type Field = (fn(DVec3) -> f64, fn(DVec3) -> DVec3);
    let linear: Field = (|p| 1.0 + 2.0 * p.x - p.y + 0.5 * p.z, |_| DVec3::new(2.0, -1.0, 0.5));
    let square: Field = (|p| p.x * p.x - 2.0 * p.z * p.z, |p| DVec3::new(2.0 * p.x, 0.0, -4.0 * p.z));
    let fourth: Field = (|p| p.x.powi(4), |p| DVec3::X * 4.0 * p.x.powi(3));
    let cube: Field = (|p| p.y * p.y * p.y, |p| DVec3::new(0.0, 3.0 * p.y * p.y, 0.0));
    for table in &tables {
        for (interpolation, exact, not) in [
            ("trilinear", linear, square),
            ("gradient_corrected", linear, square),
            ("half_gradient", square, cube),
            ("tricubic", cube, fourth),
        ] {
            let table = table.replace("INTERPOLATION", interpolation);
            let error = |field: Field| {
                let volume = filled(baked(&table), field.0, field.1);
                let vectors = volume.vectors();
                places(400, volume.bounds.half)
                    .map(|q| (value(&volume, &vectors, q)[0] - field.0(q)).abs())
                    .fold(0.0, f64::max)
            };
            assert!(error(exact) < 1e-12, "{table}: {}", error(exact));
            assert!(error(not) > 1e-6, "{table}: the next degree must not be exact");
        }
    }
}

#[test]
fn constant_light_is_constant_everywhere_and_f32_agrees() {
    let ambient = [surroundings([1.0, 2.0, 3.0])];
    for table in [
        format!("grid = {{ {BOX}, samples = [3, 3, 3] }}"),
        format!("octree = {{ {BOX}, min_level = 2, max_level = 3 }}"),
    ] {
        let volume = bake(&Volume::inline(&table).unwrap(), &prober(&ambient, None, Probes::Analytic)).unwrap();
        let vectors = volume.vectors();
        for q in places(50, volume.bounds.half) {
            // E = pi L is L_0 Y_0 A_0 = L_0 sqrt(pi)/2
            let e = value(&volume, &vectors, q)[1] * PI.sqrt() / 2.0;
            assert!((e - 2.0 * PI).abs() < 1e-10, "{table}: {e}");
        }
    }
    let volume = baked(&octree("interpolation = \"half_gradient\""));
    let (doubles, singles) = (volume.vectors(), volume.vectors().rounded::<f32>());
    let model = volume.model::<f32>();
    let scale = doubles.data.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    for q in places(500, volume.bounds.half) {
        let mut sum = vec![0.0f32; singles.stride()];
        model.taps(Vector3::of(q), &mut |vector, weight| {
            sum.iter_mut().zip(singles.vector(vector)).for_each(|(s, v)| *s += weight * v);
        });
        for (a, b) in sum.iter().zip(value(&volume, &doubles, q)) {
            assert!((f64::from(*a) - b).abs() < 2e-6 * scale, "{q}: {a} for {b}");
        }
    }
}

#[test]
fn more_levels_come_closer_to_the_truth_and_cost_more() {
    let lights = lights();
    let mut last = (f64::INFINITY, 0);
    for level in [1, 2, 3] {
        let table = format!("octree = {{ {BOX}, min_level = 0, max_level = {level}, heuristic = \"error\" }}");
        let volume = baked(&table);
        let vectors = volume.vectors();
        let around = prober(&lights, None, Probes::Analytic);
        let (mut error, mut total) = (0.0, 0.0);
        for q in places(300, volume.bounds.half) {
            let (truth, _) = around.take(&[SampleRequest::value_at(q.to_array())]);
            for (a, b) in value(&volume, &vectors, q).iter().zip(&truth.vectors.data) {
                error += (a - b).powi(2);
                total += b * b;
            }
        }
        let relative = (error / total).sqrt();
        assert!(relative < 0.8 * last.0 && volume.places.len() > last.1, "level {level}: {relative} after {last:?}");
        last = (relative, volume.places.len());
    }
}

#[test]
fn pruning_and_culling_keep_what_the_field_needs() {
    let full = 17usize.pow(3);
    let pruned = baked(&format!("octree = {{ {BOX}, min_level = 1, max_level = 4, heuristic = \"prune\" }}"));
    assert_eq!(pruned.counts.taken as usize, full, "pruning samples everything first");
    assert!(pruned.places.len() < full / 3, "{} of {full}", pruned.places.len());
    // near the lamp it stays fine
    let finest = cells(&pruned).cells.iter().map(|c| c.size).min().unwrap();
    assert_eq!(finest, 2);
    let plain = baked(&octree("interpolation = \"trilinear\""));
    let culled = baked(&octree("interpolation = \"trilinear\", cull = 0.2"));
    assert!(culled.places.len() < plain.places.len(), "{} of {}", culled.places.len(), plain.places.len());
    let none = baked(&octree("interpolation = \"trilinear\", cull = 1e-9"));
    assert_eq!(none.places.len(), plain.places.len());
}

fn grey(albedo: f64) -> TracedMaterial {
    TracedMaterial { albedo: Rgb::splat(albedo), emission: Rgb::zero() }
}

/// A closed box within the room, faces outwards.
fn block() -> TracedGeometry {
    let mut geometry = TracedGeometry::default();
    let (low, high) = (DVec3::new(-0.7, -0.4, -0.5), DVec3::new(-0.1, 0.2, 0.1));
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let out = DVec3::AXES[axis] * side;
            let u = DVec3::AXES[(axis + 1) % 3];
            let v = out.cross(u);
            geometry.add_quad(grey(0.5), middle + out * half, u * half, v * half);
        }
    }
    geometry
}

#[test]
fn cells_with_geometry_are_divided_by_triangles_and_by_depth() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(16), seed: 1 });
    let inside = |volume: &BakedVolume| {
        let cells = cells(volume);
        let crossed = |cell: &rigbench::volume::Cell| {
            let [low, high] = [cell.low, cell.low.map(|u| u + cell.size)]
                .map(|place| DVec3::from_array(cells.position(place)) + volume.bounds.center);
            // crossed by the surface: neither apart from the block nor within it
            let (a, b) = (DVec3::new(-0.7, -0.4, -0.5), DVec3::new(-0.1, 0.2, 0.1));
            let apart = low.cmpgt(b).any() || high.cmplt(a).any();
            let within = low.cmpgt(a).all() && high.cmplt(b).all();
            !apart && !within
        };
        let finest = cells.cells.iter().map(|c| c.size).min().unwrap();
        let of = |wanted: bool| cells.cells.iter().filter(move |c| crossed(c) == wanted).map(move |c| c.size == finest);
        (of(true).all(|fine| fine), of(false).filter(|fine| !fine).count())
    };
    let table = |text: &str| format!("octree = {{ {BOX}, min_level = 1, max_level = 4, heuristic = \"{text}\" }}");
    let volume = bake(&Volume::inline(&table("contains_geometry")).unwrap(), &around).unwrap();
    let (all_fine, coarse) = inside(&volume);
    assert!(all_fine, "every cell that the surface crosses is as fine as can be");
    assert!(coarse > 20, "and others are not: {coarse}");
    // the historic rule looks at depths, and divides near the block first
    let volume = bake(&Volume::inline(&table("harmonic_mean")).unwrap(), &around).unwrap();
    assert!(volume.counts.depth_rays > 0);
    assert!(cells(&volume).cells.len() > 50);

    // two-level: an inner grid where the block is
    let table = format!("two_level = {{ {BOX}, samples = [5, 5, 5], inner = 4 }}");
    let volume = bake(&Volume::inline(&table).unwrap(), &around).unwrap();
    let (all_fine, coarse) = inside(&volume);
    assert!(all_fine && coarse > 10);
}

#[test]
fn samples_inside_geometry_are_found_and_repaired() {
    let tracer = Tracer::new(&block());
    let lights = [surroundings([1.0; 3])];
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(64), seed: 1 });
    let with = |repair: bool| {
        let table = format!("grid = {{ {BOX}, samples = [11, 11, 11], repair = {repair} }}");
        bake(&Volume::inline(&table).unwrap(), &around).unwrap()
    };
    let (dark, repaired) = (with(false), with(true));
    let contained = dark
        .places
        .iter()
        .filter(|place| {
            let p = DVec3::from_array(**place) + dark.bounds.center;
            p.cmpgt(DVec3::new(-0.7, -0.4, -0.5)).all() && p.cmplt(DVec3::new(-0.1, 0.2, 0.1)).all()
        })
        .count();
    assert!(contained > 10);
    assert_eq!(dark.counts.inside as usize, contained);
    assert_eq!(repaired.counts.repaired as usize, contained);
    let least = |volume: &BakedVolume| {
        (0..volume.places.len()).map(|i| volume.values.vector(i)[0]).fold(f64::INFINITY, f64::min)
    };
    assert_eq!(least(&dark), 0.0);
    assert!(least(&repaired) > 0.5, "{}", least(&repaired));
}

#[test]
fn a_budget_is_held_and_says_how_to_raise_it() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let volume = Volume::inline(&octree("budget = 300")).unwrap();
    match bake(&volume, &around) {
        Err(error @ BakeError::Budget { .. }) => {
            let text = error.to_string();
            assert!(text.contains("budget = N") && text.contains("300"), "{text}");
        }
        other => panic!("{other:?}"),
    }
    for (table, says) in [
        ("octree = { bounds = \"room\", min_level = 3, max_level = 2 }", "below min_level"),
        ("octree = { bounds = \"room\", min_level = 1, max_level = 13 }", "0 to 12"),
        ("octree = { bounds = \"room\", min_level = 7, max_level = 7 }", "budget is 100000"),
        ("octree = { bounds = \"room\", min_level = 1, max_level = 7, heuristic = \"prune\" }", "budget"),
        ("octree = { bounds = \"room\", min_level = 1, max_level = 2, interpolation = \"nearest\" }", "continuous"),
        ("octree = { bounds = \"room\", min_level = 1, max_level = 2, heuristic = \"gradent\" }", "gradent"),
        ("grid = { bounds = { min = [0, 0, 0], max = [1, 0, 1] }, samples = [2, 2, 2] }", "empty box"),
        ("grid = { bounds = { min = [0, 0, 0], max = [1, inf, 1] }, samples = [2, 2, 2] }", "finite"),
        ("grid = { bounds = \"room\", samples = [200, 200, 200] }", "budget"),
        ("grid = { bounds = \"room\", samples = [2, 2] }", "three"),
        ("grid = { bounds = \"room\", samples = [2, 2, 2], smoothing = 0.5 }", "per_object"),
        ("two_level = { bounds = \"room\", samples = [2, 2, 2], inner = 1 }", "2 to 64"),
    ] {
        let error = Volume::inline(table).unwrap_err();
        let text = format!("{error} {:?}", error.help);
        assert!(text.contains(says), "{table}: {text}");
    }
}

#[test]
fn a_grid_volume_is_the_lattice_over_its_box() {
    let volume = baked(&format!("grid = {{ {BOX}, samples = [3, 2, 4], interpolation = \"half_gradient\" }}"));
    let VolumeModel::Grid(_) = volume.model::<f64>() else { panic!("a grid is evaluated as a lattice") };
    assert_eq!(volume.places.len(), 24);
    assert_eq!(volume.floats(), 24 * 4 * 27);
}
