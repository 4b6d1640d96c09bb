//! Laws of irradiance volumes: what cells hold, what interpolation reproduces, what happens across levels, what heuristics divide.

#[path = "volumes/captures.rs"]
mod captures;
#[path = "volumes/heuristics.rs"]
mod heuristics;
#[path = "volumes/lookups.rs"]
mod lookups;

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::experiment::Key;
use rigbench::light::{Constant, Light, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{GradientSource, Prober, Probes, SampleRequest, depths, texels};
use rigbench::rig::{RigModel, ShVectors};
use rigbench::run::BakeLog;
use rigbench::scene::{OrientedBox, SurfacePoint};
use rigbench::sh::Window;
use rigbench::trace::{Bounces, Effects, Effort, TracedGeometry, TracedMaterial, Tracer, Transport};
use rigbench::volume::{
    BakeCounts, BakeError, BakedVolume, Cells, Journal, Layout, NoJournal, SamplePool, Volume, VolumeModel, WithPool,
    bake, bake_along, bake_with,
};

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
    Prober { bounds: room(), order: 3, lights, transport, device: None, probes, gradients, window: Window::None }
}

fn baked(table: &str) -> BakedVolume {
    let lights = lights();
    bake(&Volume::inline(table).unwrap(), &prober(&lights, None, Probes::Analytic)).unwrap()
}

fn cells(volume: &BakedVolume) -> &Cells {
    match &volume.layout {
        Layout::Cells(cells) => cells,
        Layout::Grid(_) | Layout::Path(_) => panic!("no cells"),
    }
}

const BOX: &str = "bounds = { min = [-1, -0.6, -0.8], max = [1, 0.9, 1.2] }";

fn octree(rest: &str) -> String {
    format!("octree = {{ {BOX}, min_level = 0, max_level = 5, heuristic = \"error\", {rest} }}")
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
            let (truth, _) = around.take(&[SampleRequest::value_at(q.to_array())]).unwrap();
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
fn volumes_share_samples_and_none_can_tell() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(1)));
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(48), seed: 3 });
    let grid = Volume::inline(&format!("grid = {{ {BOX}, samples = [5, 5, 5] }}")).unwrap();
    let tree = format!("octree = {{ {BOX}, min_level = 1, max_level = 3, heuristic = \"contains_geometry\" }}");
    let tree = Volume::inline(&tree).unwrap();
    let pool = std::sync::Arc::new(SamplePool::default());
    let pooled = |volume: &Volume| {
        let mut journal = WithPool { journal: Box::new(NoJournal), pool: pool.clone() };
        bake_with(volume, &around, &[], &mut journal).unwrap()
    };
    let first = pooled(&grid);
    assert_eq!(pool.len(), 125);
    let second = pooled(&tree);
    // all of the grid's places are corners of the tree's second level
    let shared = 125 + second.counts.taken as usize - pool.len();
    assert!(shared > 50, "{shared}");
    for (volume, with) in [(&grid, &first), (&tree, &second)] {
        let without = bake(volume, &around).unwrap();
        assert_eq!((&with.values, &with.inside, &with.layout), (&without.values, &without.inside, &without.layout));
        assert_eq!(with.counts.rays, without.counts.rays);
        assert_eq!((with.counts.taken, with.counts.projections), (without.counts.taken, without.counts.projections));
    }
    // again, with everything there: the seconds are those of the samples, not of the search for them
    let again = pooled(&tree);
    assert_eq!(again.values, second.values);
    assert!(
        again.counts.seconds > 0.3 * second.counts.seconds,
        "{} of {}",
        again.counts.seconds,
        second.counts.seconds
    );
}

#[test]
fn a_budget_is_held_and_says_how_to_raise_it() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let volume = Volume::inline(&octree("budget = 100")).unwrap();
    match bake(&volume, &around) {
        Err(error @ BakeError::Budget { .. }) => {
            let text = error.to_string();
            assert!(text.contains("budget = N") && text.contains("100"), "{text}");
        }
        other => panic!("{:?}", other.map(|volume| volume.counts)),
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

/// The debug picture: every cell that is cut, and the samples at their corners, whatever the counts round to.
#[test]
fn a_section_shows_every_cell_and_sample_of_its_plane() {
    for (x, z) in [(2, 2), (3, 13), (4, 11), (7, 5)] {
        let volume = baked(&format!("grid = {{ {BOX}, samples = [{x}, 3, {z}] }}"));
        let section = volume.section(1, &[]);
        assert_eq!((section.cells.len(), section.samples.len()), ((x - 1) * (z - 1), x * z), "{x} x {z}");
    }
    let tree = baked(&octree("interpolation = \"trilinear\""));
    let section = tree.section(1, &[]);
    let area = |[low, high]: &[[f64; 2]; 2]| (high[0] - low[0]) * (high[1] - low[1]);
    let whole = 4.0 * tree.bounds.half[0] * tree.bounds.half[2];
    assert!((section.cells.iter().map(area).sum::<f64>() / whole - 1.0).abs() < 1e-9);
    assert!(section.samples.len() > section.cells.len());
}

/// The inside of a box that shines and reflects everywhere.
fn furnace(emission: f64, albedo: f64) -> TracedGeometry {
    let mut geometry = TracedGeometry::default();
    let material = TracedMaterial { albedo: Rgb::splat(albedo), emission: Rgb::splat(emission) };
    let half = DVec3::new(1.5, 1.2, 1.6);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let inwards = DVec3::AXES[axis] * -side;
            let u = DVec3::AXES[(axis + 1) % 3];
            geometry.add_quad(material, -inwards * half, u * half, inwards.cross(u) * half);
        }
    }
    geometry
}

/// A sphere of triangles that shines outwards.
fn ball(center: DVec3, radius: f64, emission: f64) -> TracedGeometry {
    let mut geometry = TracedGeometry::default();
    let material = TracedMaterial { albedo: Rgb::zero(), emission: Rgb::splat(emission) };
    let at = |i: usize, j: usize| {
        let (theta, phi) = (PI * i as f64 / 24.0, 2.0 * PI * j as f64 / 48.0);
        center + DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * radius
    };
    let mut triangles = Vec::new();
    for i in 0..24 {
        for j in 0..48 {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.extend([[a, c, b], [a, d, c]]);
        }
    }
    geometry.add(material, triangles);
    geometry
}

fn sampled(prober: &Prober, place: DVec3) -> (Vec<f64>, rigbench::trace::Counters) {
    let position = prober.bounds.local(place).to_array();
    let (sampled, counters) = prober.take(&[SampleRequest { position, derivatives: [true; 3] }]).unwrap();
    (sampled.vectors.data, counters)
}

#[test]
fn captured_furnaces_are_exact_whatever_the_face() {
    let tracer = Tracer::new(&furnace(1.0, 0.0));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(0)));
    for face in [4, 7, 32] {
        let around = prober(&[], Some(&transport), Probes::Captured { face, paths: 1, seed: 1, on_gpu: false });
        let (data, _) = sampled(&around, DVec3::new(0.2, -0.1, 0.3));
        // L_0 = 2 sqrt(pi) L by exact solid angles; the other bands by quadrature
        assert!((data[0] - 2.0 * PI.sqrt()).abs() < 1e-12, "{face}: {}", data[0]);
        let others = data[3..27].iter().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(others < 0.7 / f64::from(face * face), "{face}: {others}");
    }
    // reflected light by paths: E = pi L (1 + a + a^2 + ...)
    let tracer = Tracer::new(&furnace(1.0, 0.5));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Infinite));
    let around = prober(&[], Some(&transport), Probes::Captured { face: 16, paths: 16, seed: 1, on_gpu: false });
    let (data, _) = sampled(&around, DVec3::ZERO);
    assert!((data[0] / (4.0 * PI.sqrt()) - 1.0).abs() < 0.02, "{}", data[0]);
}

#[test]
fn captured_light_comes_to_what_rays_find() {
    let tracer = Tracer::new(&block());
    let mut lights = lights();
    lights.push(surroundings([0.3, 0.3, 0.3]));
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(1)));
    let place = DVec3::new(0.3, 0.3, 0.6);
    let traced = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(60_000), seed: 1 });
    let (truth, _) = sampled(&traced, place);
    let error = |face: u32| {
        let around = prober(&lights, Some(&transport), Probes::Captured { face, paths: 16, seed: 2, on_gpu: false });
        let (data, _) = sampled(&around, place);
        let apart: f64 = data[..27].iter().zip(&truth[..27]).map(|(a, b)| (a - b).powi(2)).sum();
        (apart / truth[..27].iter().map(|b| b * b).sum::<f64>()).sqrt()
    };
    let (coarse, fine) = (error(6), error(96));
    assert!(fine < 0.01, "{fine}");
    assert!(coarse > 2.0 * fine, "few texels miss the shapes of lights: {coarse} and {fine}");
}

#[test]
fn gradients_three_ways_agree_on_a_curved_scene_and_say_what_they_clamp() {
    let center = DVec3::new(1.9, 0.3, 0.2);
    let tracer = Tracer::new(&ball(center, 0.5, 3.0));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(0)));
    let light = [Light::Sphere(Sphere { center: Vector3::of(center), radius: 0.5, radiance: Rgb::splat(3.0) })];
    let place = DVec3::new(0.2, 0.1, 0.0);
    let (exact, _) = sampled(&prober(&light, None, Probes::Analytic), place);
    let with = |probes: Probes, gradients: GradientSource| {
        sampled(&Prober { gradients, ..prober(&[], Some(&transport), probes) }, place)
    };
    let apart = |data: &[f64]| {
        let sum: f64 = data[27..].iter().zip(&exact[27..]).map(|(a, b)| (a - b).powi(2)).sum();
        (sum / exact[27..].iter().map(|b| b * b).sum::<f64>()).sqrt()
    };
    let captured = Probes::Captured { face: 256, paths: 1, seed: 1, on_gpu: false };
    let (semi, counters) = with(captured, GradientSource::Analytic);
    assert!(apart(&semi) < 0.06, "{}", apart(&semi));
    assert!(counters.gradient_terms > 1000);
    let share = counters.clamped_gradients as f64 / counters.gradient_terms as f64;
    assert!(share < 0.02, "{share}");
    let (central, _) = with(captured, GradientSource::Central { step: 0.1 });
    assert!(apart(&central) < 0.06, "{}", apart(&central));
    let traced = Probes::Traced { effort: Effort::Samples(40_000), seed: 1 };
    let (rays, _) = with(traced, GradientSource::Analytic);
    assert!(apart(&rays) < 0.06, "{}", apart(&rays));
    // a planted wrong gradient is told apart
    let wrong: Vec<f64> = semi.iter().enumerate().map(|(i, v)| if i < 27 { *v } else { -v }).collect();
    assert!(apart(&wrong) > 1.0);
}

#[test]
fn depths_of_a_box_by_closed_form() {
    let half = DVec3::new(1.5, 1.2, 1.6);
    let tracer = Tracer::new(&furnace(1.0, 0.0));
    let found = depths(&tracer, DVec3::ZERO, &texels(64), |place| {
        assert!(((place.abs() / half).max_element() - 1.0).abs() < 1e-5);
    });
    assert!((found.minimum - 1.2).abs() < 1e-3, "{found:?}");
    assert_eq!(found.behind, 0.0);
    // 1/depth = max |w_i|/half_i, integrated over many even directions
    let count = 200_000;
    let mean: f64 = (0..count)
        .map(|k| {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / f64::from(count);
            let phi = PI * (3.0 - 5f64.sqrt()) * f64::from(k);
            let r = (1.0 - z * z).sqrt();
            (DVec3::new(r * phi.cos(), r * phi.sin(), z).abs() / half).max_element()
        })
        .sum::<f64>()
        / f64::from(count);
    assert!((found.harmonic_mean * mean - 1.0).abs() < 1e-3, "{} and {}", found.harmonic_mean, 1.0 / mean);
}

#[test]
fn each_iteration_of_a_dynamic_volume_adds_a_bounce() {
    let tracer = Tracer::new(&furnace(1.0, 0.5));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Infinite));
    let table = format!("grid = {{ {BOX}, samples = [2, 2, 2] }}");
    let mut sum = 0.0;
    for iterations in 0..6 {
        sum += 0.5f64.powi(iterations);
        let around = prober(&[], Some(&transport), Probes::Relit { face: 8, iterations: iterations as u32, seed: 1 });
        let volume = bake(&Volume::inline(&table).unwrap(), &around).unwrap();
        let level = volume.values.data[0] / (2.0 * PI.sqrt());
        assert!((level / sum - 1.0).abs() < 2e-3, "{iterations}: {level} for {sum}");
    }
}

/// A closed room like the Cornell box, walls of three colours and a panel that glows under its ceiling; `twice`: each albedo is squared.
fn cornell(twice: bool) -> TracedGeometry {
    let wall = |r: f64, g: f64, b: f64| {
        let albedo = Rgb::new(r, g, b);
        TracedMaterial { albedo: if twice { albedo * albedo } else { albedo }, emission: Rgb::zero() }
    };
    let mut room = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * 1.5, DVec3::Y * 1.2, DVec3::Z * 1.6);
    for (material, out, u, v) in [
        (wall(0.7, 0.2, 0.4), -x, y, z),
        (wall(0.2, 0.7, 0.4), x, z, y),
        (wall(0.6, 0.6, 0.6), -y, z, x),
        (wall(0.6, 0.6, 0.6), y, x, z),
        (wall(0.6, 0.6, 0.6), -z, x, y),
        (wall(0.6, 0.6, 0.6), z, y, x),
    ] {
        room.add_quad(material, out, u, v);
    }
    let panel = TracedMaterial { albedo: Rgb::zero(), emission: Rgb::splat(5.0) };
    room.add_quad(panel, DVec3::Y * 1.15, DVec3::X * 0.5, DVec3::Z * 0.5);
    room
}

/// Iterated volumes in a closed room: light grows from iteration to iteration, by steps that shrink as the room's walls reflect, to what
/// paths say.
#[test]
fn iterations_of_a_dynamic_volume_converge_to_what_is_traced() {
    let table = "grid = { bounds = { min = [-1.45, -1.15, -1.55], max = [1.45, 1.1, 1.55] }, samples = [5, 5, 6] }";
    let volume = Volume::inline(table).unwrap();
    let bounds = OrientedBox::aligned(DVec3::new(-1.45, -1.15, -1.55), DVec3::new(1.45, 1.1, 1.55));
    // interior places, six normals each
    let points: Vec<SurfacePoint> = places(6, [0.9, 0.7, 1.0])
        .flat_map(|p| DVec3::AXES.into_iter().flat_map(move |n| [n, -n].map(|normal| (p, normal))))
        .map(|(p, normal)| SurfacePoint { position: p - DVec3::Y * 0.1, normal })
        .collect();
    let of_points = |room: &TracedGeometry, iterations: u32| -> Vec<Rgb<f64>> {
        let tracer = Tracer::new(room);
        let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Infinite));
        let probes = Probes::Relit { face: 8, iterations, seed: 1 };
        let baked = bake(&volume, &Prober { bounds, ..prober(&[], Some(&transport), probes) }).unwrap();
        let vectors = baked.vectors().convolved(rigbench::sh::Lobe::<f64>::lambert().bands());
        let mut local = rigbench::rig::LocalPoints::<f64>::default();
        points.iter().for_each(|p| local.push(bounds.local(p.position), p.normal));
        let mut out = vec![Rgb::zero(); points.len()];
        rigbench::rig::plain_irradiance::<f64, _, 9>(&baked.model::<f64>(), &vectors, &local, &mut out);
        out
    };
    let truth: Vec<Rgb<f64>> = {
        let tracer = Tracer::new(&cornell(false));
        let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Infinite));
        let seed = rigbench::trace::Seed { seed: 7, purpose: StreamPurpose::Test };
        let lobe = rigbench::sh::Lobe::lambert();
        transport.irradiance(&points, &lobe, seed, Effort::Samples(4096)).iter().map(|e| e.value).collect()
    };
    let rms = |v: &[Rgb<f64>]| (v.iter().map(|e| e.g * e.g).sum::<f64>() / v.len() as f64).sqrt();
    let apart = |a: &[Rgb<f64>], b: &[Rgb<f64>]| rms(&a.iter().zip(b).map(|(a, b)| *a - *b).collect::<Vec<_>>());
    // green, by area: four walls of 0.6, one of 0.2 and one of 0.7 (the panel hides a little of the ceiling)
    let (side, end, floor) = (2.4 * 3.2, 3.0 * 2.4, 3.0 * 3.2);
    let mean_albedo = (0.6 * 2.0 * (end + floor) + (0.2 + 0.7) * side) / (2.0 * (side + end + floor));
    // errors of the ratio of the steps to the mean albedo, and of what is reached to the truth; whether light grows everywhere
    let judge = |room: &TracedGeometry| {
        let iterations: Vec<Vec<Rgb<f64>>> = (0..6).map(|k| of_points(room, k)).collect();
        let steps: Vec<f64> = iterations.windows(2).map(|pair| apart(&pair[1], &pair[0])).collect();
        let ratios: Vec<f64> = steps.windows(2).map(|pair| pair[1] / pair[0]).collect();
        let grows = iterations.windows(2).all(|pair| pair[0].iter().zip(&pair[1]).all(|(a, b)| b.g > a.g));
        let converged = of_points(room, 16);
        let left = iterations.iter().map(|k| apart(k, &converged)).collect::<Vec<f64>>();
        let nearer = left.windows(2).all(|pair| pair[1] < pair[0]);
        let error = apart(&converged, &truth) / rms(&truth);
        println!("ratios {ratios:?} for {mean_albedo}, error {error}, grows {grows}, nearer {nearer}");
        // the first steps are still those of the panel's own light, which falls on the floor most
        let off = ratios[1..].iter().map(|ratio| (ratio / mean_albedo - 1.0).abs()).fold(0.0, f64::max);
        (off, error, grows && nearer)
    };
    let (off, error, grows) = judge(&cornell(false));
    assert!(grows && off < 0.1 && error < 0.15, "ratios off by {off}, error {error}");
    let (off, error, _) = judge(&cornell(true));
    assert!(off > 0.2 && error > 0.2, "the albedo used twice: ratios off by {off}, error {error}");
}

#[test]
fn a_path_is_read_by_time() {
    let lights = lights();
    let volume = Volume::inline("path = { samples = 5 }").unwrap();
    let track: Vec<DVec3> = (0..5).map(|k| DVec3::new(-0.8 + 0.4 * f64::from(k), 0.1, 0.2)).collect();
    let around =
        Prober { bounds: OrientedBox::aligned(DVec3::NEG_ONE, DVec3::ONE), ..prober(&lights, None, Probes::Analytic) };
    let baked = bake_along(&volume, &around, &track).unwrap();
    for (k, place) in track.iter().enumerate() {
        let (truth, _) = sampled(&around, *place);
        let found = baked.along_path(0, k as f64 / 4.0);
        for (a, b) in found.concat().iter().zip(&truth) {
            assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "{k}: {a} for {b}");
        }
    }
    // between samples: the mean at half the way
    let [middle, ..] = baked.along_path(0, 0.125);
    let ([a, ..], [b, ..]) = (baked.along_path(0, 0.0), baked.along_path(0, 0.25));
    assert!(middle.iter().zip(a.iter().zip(&b)).all(|(m, (a, b))| (m - 0.5 * (a + b)).abs() < 1e-12));
}

#[test]
fn a_bake_that_was_cut_short_goes_on_with_what_its_log_holds() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(2)));
    let error = Effort::Error { relative: 0.1, most_samples: 4096, deadline: None };
    let tree = octree("max_level = 3, interpolation = \"half_gradient\"").replace("max_level = 5, ", "");
    let grid = format!("grid = {{ {BOX}, samples = [5, 5, 5] }}");
    for (table, probes) in [
        (&tree, Probes::Traced { effort: Effort::Samples(24), seed: 1 }),
        (&grid, Probes::Traced { effort: error, seed: 1 }),
        (&grid, Probes::Relit { face: 4, iterations: 2, seed: 1 }),
    ] {
        let volume = Volume::inline(table).unwrap();
        let around = prober(&lights, Some(&transport), probes);
        let baked = |journal: &mut dyn Journal| {
            let baked = bake_with(&volume, &around, &[], journal).unwrap();
            let BakeCounts { recalled, traced_now, .. } = baked.counts;
            let counts = BakeCounts { recalled: 0, traced_now: 0, seconds: 0.0, ..baked.counts };
            (BakedVolume { counts, ..baked }, recalled, traced_now)
        };
        let (whole, none, all_rays) = baked(&mut NoJournal);
        assert_eq!((none, all_rays), (0, whole.counts.rays.rays()));

        let folder = tempfile::tempdir().unwrap();
        let key = Key::of_bytes(table.as_bytes());
        let log = || BakeLog::open(folder.path(), &key).unwrap();
        let (logged, none, rays) = baked(&mut log());
        assert_eq!((&logged, none, rays), (&whole, 0, all_rays));
        let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        // nothing is traced again where all is there
        assert_eq!(baked(&mut log()), (whole.clone(), whole.counts.taken, 0));

        let mut stream = Stream::indexed(3, StreamPurpose::Test, 8);
        let mut shares: Vec<f64> = (0..4).map(|_| stream.uniform()).collect();
        shares.sort_by(f64::total_cmp);
        let mut left = all_rays + 1;
        for share in shares {
            let cut = (share * bytes.len() as f64) as usize;
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let (again, recalled, rays) = baked(&mut log());
            assert_eq!(again, whole, "cut at {cut} of {}", bytes.len());
            // a cut loses one stretch at most, and what stands before it is not traced again
            let lost = whole.counts.taken as f64 * (1.0 - share) + 128.0;
            assert!(recalled as f64 >= whole.counts.taken as f64 - lost, "{recalled} at {share}");
            assert!(
                rays <= left && rays > 0 && (recalled > 0) == (rays < all_rays),
                "{rays} rays, {recalled} at {share}"
            );
            left = rays;
            // and the log is whole again
            assert_eq!(baked(&mut log()), (whole.clone(), whole.counts.taken, 0));
        }
        // a log of another bake is none
        let other = bake_with(
            &volume,
            &prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(2), seed: 9 }),
            &[],
            &mut BakeLog::open(folder.path(), &Key::of_bytes(b"other")).unwrap(),
        )
        .unwrap();
        assert_eq!(other.counts.recalled, 0);
        assert_ne!(other.values, whole.values);
    }
}

/// Volumes of one sweep share samples. Killed while the second is baked, the sweep goes on with what either log holds: what the first one's
/// has is not traced again for the second, wherever that one's log ends.
#[test]
fn of_two_volumes_that_were_cut_short_nothing_is_traced_again_that_a_log_holds() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(1)));
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(24), seed: 3 });
    let tables = [
        format!("grid = {{ {BOX}, samples = [5, 5, 5] }}"),
        format!("octree = {{ {BOX}, min_level = 1, max_level = 3, heuristic = \"contains_geometry\" }}"),
    ];
    let key = |table: &str| Key::of_bytes(table.as_bytes());
    let sweep = |folder: &std::path::Path| {
        let pool = std::sync::Arc::new(SamplePool::default());
        tables.each_ref().map(|table| {
            let log = Box::new(BakeLog::open(folder, &key(table)).unwrap());
            let mut journal = WithPool { journal: log, pool: pool.clone() };
            let volume = Volume::inline(table).unwrap();
            let baked = bake_with(&volume, &around, &[], &mut journal).unwrap();
            let BakeCounts { recalled, traced_now, .. } = baked.counts;
            let counts = BakeCounts { recalled: 0, traced_now: 0, seconds: 0.0, ..baked.counts };
            (BakedVolume { counts, ..baked }, recalled, traced_now)
        })
    };
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = sweep(folder.path());
    let alone = second.0.counts.rays.rays();
    assert!(first.2 == first.0.counts.rays.rays() && second.2 < alone * 3 / 4, "{} of {alone} rays", second.2);
    let log = folder.path().join(format!("{}.samples", key(&tables[1]).hex()));
    let bytes = std::fs::read(&log).unwrap();
    let mut stream = Stream::indexed(3, StreamPurpose::Test, 9);
    let mut cuts: Vec<usize> = (0..5).map(|_| (stream.uniform() * bytes.len() as f64) as usize).collect();
    cuts.extend([0, bytes.len()]);
    cuts.sort_unstable();
    let mut most = second.2;
    for cut in cuts {
        std::fs::write(&log, &bytes[..cut]).unwrap();
        let [again_first, again] = sweep(folder.path());
        assert_eq!((&again_first.0, again_first.1, again_first.2), (&first.0, first.0.counts.taken, 0), "cut at {cut}");
        assert_eq!(again.0, second.0, "cut at {cut}");
        assert!(again.2 <= most, "cut at {cut}: {} rays, {most} where less was there", again.2);
        if cut == 0 || cut == bytes.len() {
            assert_eq!(again.2, if cut == 0 { second.2 } else { 0 }, "cut at {cut}");
        }
        most = again.2;
    }
    // without logs it is what it was
    std::fs::remove_dir_all(folder.path()).unwrap();
    assert_eq!(sweep(folder.path())[1].2, second.2);
}

/// 1/distance has no bound where a sample touches a surface: such terms are left out.
#[test]
fn samples_on_walls_have_derivatives_of_a_sensible_size() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(1)));
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(128), seed: 1 });
    let largest = |data: &[f64]| data.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let (low, high) = (DVec3::new(-0.7, -0.4, -0.5), DVec3::new(-0.1, 0.2, 0.1));
    let bright = largest(&sampled(&around, DVec3::new(0.4, 0.3, 0.6)).0[..27]);
    for k in 0..240 {
        let share = DVec3::new(0.754_877, 0.569_840, 0.413_309) * f64::from(k);
        let mut place = low + (high - low) * share.fract();
        let axis = k % 3;
        place[axis as usize] = if k % 2 == 0 { low } else { high }[axis as usize];
        let (data, _) = sampled(&around, place);
        assert!(largest(&data[27..]) < 1e4 * bright, "{place}: {} beside {bright}", largest(&data[27..]));
    }
}
