//! Every heuristic against a second computation: a tree that is built here, by other means, must have the same cells.

use std::collections::{BTreeSet, HashMap};

use glam::DVec3;
use rigbench::light::{Disk, Light, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{Prober, Probes, SampleRequest, depths, texels};
use rigbench::trace::{Effects, Effort, TracedGeometry, Tracer, Transport};
use rigbench::volume::{BakeError, BakedVolume, Criterion, Evidence, Structure, Volume, bake};

use super::{BOX, block, cells, grey, lights, prober, surroundings};

/// Half edges of the finest cell of these trees, along an axis.
const DEEPEST: u32 = 4;
const UNITS: u32 = 2 << DEEPEST;

/// Low corner and size, in half edges of the finest cell.
type Cube = ([u32; 3], u32);

fn parts((low, size): Cube) -> Vec<Cube> {
    let half = size / 2;
    (0..8u32).map(|k| (std::array::from_fn(|a| low[a] + half * (k >> a & 1)), half)).collect()
}

fn corners((low, size): Cube) -> Vec<[u32; 3]> {
    (0..8u32).map(|k| std::array::from_fn(|a| low[a] + size * (k >> a & 1))).collect()
}

/// The twelve directions to an icosahedron's corners: a mean over them is that over the sphere for polynomials up to degree 5, and E^2 of
/// order 3 has degree 4.
fn icosahedron() -> Vec<DVec3> {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut found = Vec::new();
    for (a, b) in [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)] {
        found.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    found.into_iter().map(DVec3::normalize).collect()
}

/// RMS of E over normals and channels, normal by normal.
fn rms(radiance: &[f64]) -> f64 {
    use std::f64::consts::PI;
    let normals = icosahedron();
    let mut sum = 0.0;
    for n in &normals {
        // bands 0 to 2 as polynomials of the direction, as the conventions write them
        let y = [
            (0.25 / PI).sqrt(),
            (0.75 / PI).sqrt() * n.y,
            (0.75 / PI).sqrt() * n.z,
            (0.75 / PI).sqrt() * n.x,
            (3.75 / PI).sqrt() * n.x * n.y,
            (3.75 / PI).sqrt() * n.y * n.z,
            (0.3125 / PI).sqrt() * (3.0 * n.z * n.z - 1.0),
            (3.75 / PI).sqrt() * n.x * n.z,
            (0.9375 / PI).sqrt() * (n.x * n.x - n.y * n.y),
        ];
        let factor = |i: usize| [PI, 2.0 * PI / 3.0, PI / 4.0][if i == 0 { 0 } else { 1 + usize::from(i > 3) }];
        for channel in 0..3 {
            let e: f64 = (0..9).map(|i| factor(i) * radiance[3 * i + channel] * y[i]).sum();
            sum += e * e;
        }
    }
    (sum / (3.0 * normals.len() as f64)).sqrt()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    rms(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>())
}

/// Samples of the same prober, taken one by one and asked for by place.
struct Field<'a> {
    prober: &'a Prober<'a>,
    known: HashMap<[u32; 3], Vec<f64>>,
    mean: f64,
    /// Share of the mean that differences are held against at least.
    floor: f64,
    /// Share of the corners' derivatives in what they give at a centre.
    share: f64,
}

impl<'a> Field<'a> {
    /// The mean is over the corners of the cells of the least level.
    fn new(prober: &'a Prober<'a>, least: &BTreeSet<Cube>) -> Self {
        let mut field = Self { prober, known: HashMap::new(), mean: 0.0, floor: 0.01, share: 0.0 };
        let places: BTreeSet<[u32; 3]> = least.iter().flat_map(|cube| corners(*cube)).collect();
        let sum: f64 = places.iter().map(|place| rms(&field.value(*place))).sum();
        field.mean = sum / places.len() as f64;
        field
    }

    fn metres(&self, place: [u32; 3]) -> [f64; 3] {
        let half = self.prober.bounds.half;
        std::array::from_fn(|a| half[a] * (2.0 * f64::from(place[a]) / f64::from(UNITS) - 1.0))
    }

    /// Value, then the derivatives along the axes.
    fn all(&mut self, place: [u32; 3]) -> Vec<f64> {
        let position = self.metres(place);
        let prober = self.prober;
        self.known
            .entry(place)
            .or_insert_with(|| {
                prober.take(&[SampleRequest { position, derivatives: [true; 3] }]).unwrap().0.vectors.data
            })
            .clone()
    }

    fn value(&mut self, place: [u32; 3]) -> Vec<f64> {
        self.all(place)[..27].to_vec()
    }

    fn local(&self, value: &[f64]) -> f64 {
        rms(value).max(self.floor * self.mean)
    }

    fn edges(&self, size: u32) -> [f64; 3] {
        self.prober.bounds.half.map(|half| 2.0 * half * f64::from(size) / f64::from(UNITS))
    }

    /// What the corners give at a share of the way along each axis.
    fn between(&mut self, cube: Cube, share: [f64; 3]) -> Vec<f64> {
        let mut sum = vec![0.0; 27];
        for (k, corner) in corners(cube).into_iter().enumerate() {
            let weight: f64 = (0..3).map(|a| if k >> a & 1 == 1 { share[a] } else { 1.0 - share[a] }).product();
            sum.iter_mut().zip(self.value(corner)).for_each(|(s, v)| *s += weight * v);
        }
        sum
    }

    fn error(&mut self, cube: Cube, threshold: f64) -> bool {
        let truth = self.value(centre(cube));
        let mut guess = self.between(cube, [0.5; 3]);
        // each corner adds a share of its first-order change to the centre, an eighth of it
        let edges = self.edges(cube.1);
        for (k, corner) in corners(cube).into_iter().enumerate() {
            let all = self.all(corner);
            for axis in 0..3 {
                let step = if k >> axis & 1 == 1 { -0.5 } else { 0.5 } * edges[axis];
                for (i, sum) in guess.iter_mut().enumerate() {
                    *sum += 0.125 * self.share * step * all[27 * (axis + 1) + i];
                }
            }
        }
        apart(&guess, &truth) > threshold * self.local(&truth)
    }

    fn gradient(&mut self, cube: Cube, threshold: f64) -> bool {
        let edges = self.edges(cube.1);
        corners(cube).into_iter().chain([centre(cube)]).any(|place| {
            let all = self.all(place);
            let change: f64 = (0..3).map(|a| (edges[a] * rms(&all[27 * (a + 1)..27 * (a + 2)])).powi(2)).sum();
            change.sqrt() > threshold * self.local(&all[..27])
        })
    }

    /// Whether the middles of a cube's edges, faces and the cube itself are what its corners give.
    fn needs_no_parts(&mut self, cube: Cube, tolerance: f64) -> bool {
        let (low, size) = cube;
        (0..27u32).all(|k| {
            let step = [k % 3, k / 3 % 3, k / 9];
            let place = std::array::from_fn(|a| low[a] + step[a] * size / 2);
            let truth = self.value(place);
            apart(&self.between(cube, step.map(|s| 0.5 * f64::from(s))), &truth) <= tolerance * self.local(&truth)
        })
    }
}

fn centre((low, size): Cube) -> [u32; 3] {
    low.map(|u| u + size / 2)
}

fn least_level(level: u32) -> BTreeSet<Cube> {
    let mut cubes = BTreeSet::from([([0; 3], UNITS)]);
    for _ in 0..level {
        cubes = cubes.into_iter().flat_map(parts).collect();
    }
    cubes
}

/// Divides where the criterion says so, down to cells of two units.
fn divided(least: &BTreeSet<Cube>, mut wanted: impl FnMut(Cube) -> bool) -> BTreeSet<Cube> {
    let mut open: Vec<Cube> = least.iter().copied().collect();
    let mut leaves = BTreeSet::new();
    while let Some(cube) = open.pop() {
        if cube.1 > 2 && wanted(cube) {
            open.extend(parts(cube));
        } else {
            leaves.insert(cube);
        }
    }
    leaves
}

/// From the finest cells upwards: eight that stand and of which `undone` says so become one.
fn merged(leaves: BTreeSet<Cube>, largest: u32, mut undone: impl FnMut(Cube) -> bool) -> BTreeSet<Cube> {
    let mut leaves = leaves;
    let mut size = 4;
    while size <= largest {
        let parents: BTreeSet<Cube> = leaves
            .iter()
            .filter(|(_, own)| *own == size / 2)
            .map(|(low, _)| (low.map(|u| u / size * size), size))
            .collect();
        for parent in parents {
            if parts(parent).iter().all(|part| leaves.contains(part)) && undone(parent) {
                for part in parts(parent) {
                    leaves.remove(&part);
                }
                leaves.insert(parent);
            }
        }
        size *= 2;
    }
    leaves
}

/// Divides what touches a cell of less than half its size, until nothing does.
fn balanced(mut leaves: BTreeSet<Cube>) -> BTreeSet<Cube> {
    loop {
        let touches = |a: &Cube, b: &Cube| (0..3).all(|i| a.0[i] <= b.0[i] + b.1 && b.0[i] <= a.0[i] + a.1);
        let wide: Vec<Cube> =
            leaves.iter().filter(|a| leaves.iter().any(|b| a.1 > 2 * b.1 && touches(a, b))).copied().collect();
        if wide.is_empty() {
            return leaves;
        }
        for cube in wide {
            leaves.remove(&cube);
            leaves.extend(parts(cube));
        }
    }
}

fn tree(volume: &BakedVolume) -> BTreeSet<Cube> {
    cells(volume).cells.iter().map(|cell| (cell.low, cell.size)).collect()
}

fn octree(heuristic: &str, min_level: u32, rest: &str) -> Volume {
    // a matrix gives heuristics with thresholds of their own; the words have the usual ones
    Volume::inline(&format!(
        "octree = {{ {BOX}, min_level = {min_level}, max_level = {DEEPEST}, heuristic = \"{heuristic}\"{rest} }}"
    ))
    .unwrap()
}

fn divided_by(any: Vec<Criterion>, rest: &str) -> Volume {
    let mut volume = octree("error", 1, rest);
    if let Structure::Octree { heuristic, .. } = &mut volume.structure {
        heuristic.any = any;
    }
    volume
}

/// Holds a tree to one that was built here, and sees that another threshold makes another.
fn holds(what: &str, volume: &BakedVolume, expected: BTreeSet<Cube>, planted: BTreeSet<Cube>) {
    let found = tree(volume);
    let sizes: BTreeSet<u32> = found.iter().map(|c| c.1).collect();
    assert!(sizes.len() > 1, "{what}: all cells alike tell nothing");
    let missing = expected.difference(&found).count();
    assert!(found == expected, "{what}: {} cells, {} expected, {missing} of them missing", found.len(), expected.len());
    assert!(found != planted, "{what}: a threshold that is off must be seen");
}

#[test]
fn trees_by_error_gradient_and_their_combination() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let least = least_level(1);
    let mut field = Field::new(&around, &least);

    let volume = bake(&octree("error", 1, ""), &around).unwrap();
    let by = |field: &mut Field, threshold: f64| balanced(divided(&least, |cube| field.error(cube, threshold)));
    holds("error", &volume, by(&mut field, 0.05), by(&mut field, 0.08));

    let volume = bake(&octree("gradient", 1, ""), &around).unwrap();
    let by = |field: &mut Field, threshold: f64| balanced(divided(&least, |cube| field.gradient(cube, threshold)));
    holds("gradient", &volume, by(&mut field, 0.2), by(&mut field, 0.4));

    // any of a list
    let either = vec![Criterion::Error { threshold: 0.1 }, Criterion::Gradient { threshold: 0.9 }];
    let volume = bake(&divided_by(either, ""), &around).unwrap();
    let expected = balanced(divided(&least, |cube| field.error(cube, 0.1) || field.gradient(cube, 0.9)));
    let one_alone = balanced(divided(&least, |cube| field.error(cube, 0.1)));
    holds("any", &volume, expected, one_alone);
}

#[test]
fn trees_that_are_pruned_and_culled() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let least = least_level(1);
    let mut field = Field::new(&around, &least);
    let largest = UNITS / 2;

    let volume = bake(&octree("prune", 1, ""), &around).unwrap();
    let by = |field: &mut Field, tolerance: f64| {
        let all = divided(&least, |_| true);
        balanced(merged(all, largest, |cube| field.needs_no_parts(cube, tolerance)))
    };
    holds("prune", &volume, by(&mut field, 0.05), by(&mut field, 0.08));

    let volume = bake(&octree("gradient", 1, ", cull = 0.1"), &around).unwrap();
    let by = |field: &mut Field, tolerance: f64| {
        let fine = divided(&least, |cube| field.gradient(cube, 0.2));
        balanced(merged(fine, largest, |cube| field.needs_no_parts(cube, tolerance)))
    };
    holds("cull", &volume, by(&mut field, 0.1), by(&mut field, 0.02));
}

/// In a half of the box that hardly any light reaches, differences are held against 1 % of the mean and not against the little there is.
#[test]
fn what_lies_in_the_dark_is_held_against_the_mean() {
    // the disk's back is turned to the right half, in which there is a lamp as weak as a candle
    let lights: Vec<Light<f64>> = vec![
        Light::Disk(Disk {
            center: Vector3::new(0.0, 1.6, 0.2),
            normal: Vector3::new(-1.0, 0.0, 0.0),
            radius: 0.5,
            radiance: Rgb::new(9.0, 6.0, 3.0),
        }),
        Light::Sphere(Sphere {
            center: Vector3::new(1.2, 1.05, 1.4),
            radius: 0.2,
            radiance: Rgb::new(6e-3, 9e-3, 3e-3),
        }),
    ];
    let around = prober(&lights, None, Probes::Analytic);
    let least = least_level(1);
    let mut field = Field::new(&around, &least);
    type Says = fn(&mut Field, Cube) -> bool;
    let cases: [(&str, Says); 2] =
        [("error", |f, cube| f.error(cube, 0.05)), ("gradient", |f, cube| f.gradient(cube, 0.2))];
    for (word, says) in cases {
        let volume = bake(&octree(word, 1, ""), &around).unwrap();
        let mut by = |floor: f64| {
            field.floor = floor;
            balanced(divided(&least, |cube| says(&mut field, cube)))
        };
        let expected = by(0.01);
        for wrong in [0.0, 0.003, 0.03] {
            holds(word, &volume, expected.clone(), by(wrong));
        }
    }
}

/// The interpolated centre is that of the volume's own interpolation.
#[test]
fn trees_by_the_error_of_each_interpolation() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let least = least_level(1);
    let mut field = Field::new(&around, &least);
    // in the middle of a cell a cubic Hermite is half of the gradients too
    for (interpolation, share) in [("gradient_corrected", 1.0), ("half_gradient", 0.5), ("tricubic", 0.5)] {
        let rest = format!(", interpolation = \"{interpolation}\"");
        let volume = bake(&divided_by(vec![Criterion::Error { threshold: 0.02 }], &rest), &around).unwrap();
        let mut by = |share: f64| {
            field.share = share;
            balanced(divided(&least, |cube| field.error(cube, 0.02)))
        };
        holds(interpolation, &volume, by(share), by(0.0));
    }
}

/// Pruning spares what another criterion of the list wants, culling does not, whatever their tolerances.
#[test]
fn pruning_beside_other_criteria() {
    let lights = lights();
    let around = prober(&lights, None, Probes::Analytic);
    let least = least_level(1);
    let mut field = Field::new(&around, &least);
    let list = vec![Criterion::Prune { threshold: 0.05 }, Criterion::Error { threshold: 0.01 }];
    let mut by = |spared: f64| {
        let all = divided(&least, |_| true);
        balanced(merged(all, UNITS / 2, |cube| field.needs_no_parts(cube, 0.05) && !field.error(cube, spared)))
    };
    let (expected, alone) = (by(0.01), by(f64::INFINITY));
    holds(
        "prune beside error",
        &bake(&divided_by(list.clone(), ""), &around).unwrap(),
        expected.clone(),
        alone.clone(),
    );
    holds("culled by as much", &bake(&divided_by(list, ", cull = 0.05"), &around).unwrap(), alone, expected);
}

/// What is left of a triangle within a box, cut by one plane after the other.
fn is_met(triangle: &[DVec3; 3], low: DVec3, high: DVec3) -> bool {
    let mut polygon = triangle.to_vec();
    for axis in 0..3 {
        for (side, end) in [(-1.0, low[axis]), (1.0, high[axis])] {
            let beyond = |p: &DVec3| side * (p[axis] - end);
            let mut left = Vec::new();
            for (k, p) in polygon.iter().enumerate() {
                let q = polygon[(k + 1) % polygon.len()];
                let (from, to) = (beyond(p), beyond(&q));
                if from <= 0.0 {
                    left.push(*p);
                }
                if (from < 0.0) != (to < 0.0) && from != to {
                    left.push(*p + (q - *p) * (from / (from - to)));
                }
            }
            polygon = left;
            if polygon.is_empty() {
                return false;
            }
        }
    }
    true
}

/// Large and small triangles that stand askew.
fn soup() -> TracedGeometry {
    let mut stream = Stream::indexed(11, StreamPurpose::Test, 4);
    let mut geometry = TracedGeometry::default();
    let triangles: Vec<[DVec3; 3]> = (0..14)
        .map(|k| {
            let size = if k % 4 == 0 { 0.5 } else { 0.06 };
            let at = DVec3::new(0.1, 0.2, 0.3) + 0.9 * stream.direction() * stream.uniform();
            std::array::from_fn(|_| at + size * stream.direction())
        })
        .collect();
    geometry.add(grey(0.5), triangles);
    geometry
}

/// Cells with triangles, by cutting each to each cell; whether or not the scene's geometry does anything to light.
#[test]
fn trees_and_nested_grids_by_triangles() {
    let geometry = soup();
    let tracer = Tracer::new(&geometry);
    let lights = lights();
    let least = least_level(1);
    for effects in [Effects::NONE, Effects::SHADOWS] {
        let transport = Transport::new(&tracer, &lights, effects);
        let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(2), seed: 1 });
        let field = Field { prober: &around, known: HashMap::new(), mean: 0.0, floor: 0.0, share: 0.0 };
        let held = |cube: Cube, from: usize| {
            let [low, high] =
                [cube.0, cube.0.map(|u| u + cube.1)].map(|place| around.bounds.world(field.metres(place)));
            geometry.triangles[from..].iter().any(|triangle| is_met(triangle, low, high))
        };
        let volume = bake(&octree("contains_geometry", 1, ""), &around).unwrap();
        let by = |from: usize| balanced(divided(&least, |cube| held(cube, from)));
        holds("triangles", &volume, by(0), by(3));
        // samples that nothing blocks are the lights' closed forms, and none lies inside
        let exact = bake(&volume.volume, &prober(&lights, None, Probes::Analytic)).unwrap();
        assert_eq!(volume.counts.rays.rays() > 0, effects == Effects::SHADOWS);
        assert!(exact.places.len() < volume.places.len());
        if effects == Effects::NONE {
            assert_eq!((volume.counts.depth_rays, volume.counts.inside), (0, 0));
            for (place, sample) in exact.places.iter().zip(0..) {
                let own = volume.places.iter().position(|own| own == place).unwrap();
                assert_eq!(exact.values.vector(sample), volume.values.vector(own));
            }
        }

        // 4 x 2 x 4 cells of which each with geometry holds 4 x 4 x 4
        let table = format!("two_level = {{ {BOX}, samples = [5, 3, 5], inner = 4 }}");
        let volume = bake(&Volume::inline(&table).unwrap(), &around).unwrap();
        let half = around.bounds.half;
        let at = |units: [u32; 3]| -> DVec3 {
            let share = [units[0] as f64 / 16.0, units[1] as f64 / 8.0, units[2] as f64 / 16.0];
            around.bounds.world(std::array::from_fn(|a| half[a] * (share[a] - 1.0)))
        };
        let mut expected = BTreeSet::new();
        let mut divided = 0;
        for k in 0..32u32 {
            let low = [k % 4, k / 4 % 2, k / 8].map(|u| 8 * u);
            let [from, to] = [low, low.map(|u| u + 8)].map(at);
            match geometry.triangles.iter().any(|triangle| is_met(triangle, from, to)) {
                false => drop(expected.insert((low, 8))),
                true => {
                    divided += 1;
                    expected.extend(parts((low, 8)).into_iter().flat_map(parts));
                }
            }
        }
        assert!(divided > 3 && divided < 29, "{divided}");
        assert_eq!(tree(&volume), expected);
    }
}

/// One sample for each place at which cells have a corner, and no other.
#[test]
fn samples_are_the_distinct_corners_of_the_cells() {
    for table in [
        format!("octree = {{ {BOX}, min_level = 0, max_level = 5, heuristic = \"error\", roots = [2, 1, 1] }}"),
        format!("octree = {{ {BOX}, min_level = 0, max_level = 5, heuristic = \"error\", across = \"naive\" }}"),
        format!("two_level = {{ {BOX}, samples = [3, 4, 2], inner = 3 }}"),
    ] {
        let tracer = Tracer::new(&block());
        let lights = lights();
        let transport = Transport::new(&tracer, &lights, Effects::NONE);
        let volume =
            bake(&Volume::inline(&table).unwrap(), &prober(&lights, Some(&transport), Probes::Analytic)).unwrap();
        let distinct: BTreeSet<[u32; 3]> =
            cells(&volume).cells.iter().flat_map(|cell| corners((cell.low, cell.size))).collect();
        assert_eq!(distinct.len(), volume.places.len(), "{table}");
        assert_eq!(volume.counts.samples as usize, distinct.len());
        for cell in &cells(&volume).cells {
            for (sample, place) in cell.corners.iter().zip(corners((cell.low, cell.size))) {
                let metres = cells(&volume).position(place);
                assert_eq!(volume.places[*sample as usize], metres, "{table}");
            }
        }
    }
}

/// A tree or a nested grid that would burst the budget says so before it is built: what it would hold fits into no memory.
#[test]
fn geometry_that_would_burst_the_budget_is_told_before_it_is_built() {
    let mut sheet = TracedGeometry::default();
    for k in 0..40 {
        sheet.add_quad(grey(0.5), DVec3::new(0.05 * f64::from(k) - 1.0, 0.15, 0.2), DVec3::Y * 3.0, DVec3::Z * 3.0);
    }
    let tracer = Tracer::new(&sheet);
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(1), seed: 1 });
    for (table, level) in [
        (format!("two_level = {{ {BOX}, samples = [40, 40, 40], inner = 64 }}"), None),
        (octree_to_level_twelve("contains_geometry", 2000), Some(4)),
        (octree_to_level_twelve("harmonic_mean", 100), Some(3)),
    ] {
        let begun = std::time::Instant::now();
        match bake(&Volume::inline(&table).unwrap(), &around) {
            Err(error @ BakeError::Budget { .. }) => {
                let text = error.to_string();
                let BakeError::Budget { wanted, level: found, .. } = error else { unreachable!("as was matched") };
                assert!(wanted > 100 && text.contains("budget = N"), "{table}: {text}");
                assert_eq!(found, level, "{table}: {text}");
                assert_eq!(text.contains("at level"), level.is_some(), "{text}");
            }
            other => panic!("{table}: {:?}", other.map(|volume| volume.counts)),
        }
        assert!(begun.elapsed().as_secs() < 20, "{table}");
    }
}

fn octree_to_level_twelve(heuristic: &str, budget: usize) -> String {
    format!("octree = {{ {BOX}, min_level = 0, max_level = 12, heuristic = \"{heuristic}\", budget = {budget} }}")
}

#[test]
fn trees_by_depth() {
    let tracer = Tracer::new(&block());
    let ambient = [surroundings([1.0; 3])];
    let ambient: &[Light<f64>] = &ambient;
    let transport = Transport::new(&tracer, ambient, Effects::SHADOWS);
    let around = prober(ambient, Some(&transport), Probes::Traced { effort: Effort::Samples(4), seed: 1 });
    let least = least_level(1);
    let field = Field::new(&around, &least);
    let texels = texels(12);
    let look = |cube: Cube| {
        let mut seen = Vec::new();
        let place = around.bounds.world(field.metres(centre(cube)));
        let found = depths(&tracer, place, &texels, |hit| seen.push(hit));
        (found, seen)
    };
    let reach = |cube: Cube| 0.5 * field.edges(cube.1).into_iter().fold(0.0, f64::max);

    let volume = bake(&octree("harmonic_mean", 1, ""), &around).unwrap();
    let by = |threshold: f64, minimum: bool| {
        balanced(divided(&least, |cube| {
            let (found, _) = look(cube);
            found.harmonic_mean * threshold <= reach(cube) || minimum && found.minimum <= reach(cube)
        }))
    };
    holds("harmonic mean with the least depth", &volume, by(0.5, true), by(0.5, false));

    let with = |criterion: Criterion| bake(&divided_by(vec![criterion], ""), &around).unwrap();
    let volume = with(Criterion::HarmonicMean { threshold: 0.25, minimum: false });
    holds("harmonic mean alone", &volume, by(0.25, false), by(0.5, false));

    // a hit of a capture lies in the cell, by the cell's own coordinates
    let volume = with(Criterion::ContainsGeometry { from: Evidence::Depth });
    let inside = |cube: Cube, share: f64| {
        let middle = DVec3::from_array(field.metres(centre(cube)));
        let half = DVec3::from_array(field.edges(cube.1)) * 0.5 * share;
        look(cube).1.iter().any(|hit| (around.bounds.local(*hit) - middle).abs().cmple(half).all())
    };
    let by = |share: f64| balanced(divided(&least, |cube| inside(cube, share)));
    holds("geometry by depth", &volume, by(1.0), by(0.5));
}

#[test]
fn dilation_takes_the_mean_of_what_lies_outside() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(64), seed: 1 });
    let with = |repair: bool| {
        let table = format!("grid = {{ {BOX}, samples = [11, 11, 11], repair = {repair} }}");
        bake(&Volume::inline(&table).unwrap(), &around).unwrap()
    };
    let (plain, repaired) = (with(false), with(true));
    let at = |x: usize, y: usize, z: usize| x + 11 * (y + 11 * z);
    let mut checked = 0;
    for z in 1..10 {
        for y in 1..10 {
            for x in 1..10 {
                let sample = at(x, y, z);
                if !plain.inside[sample] {
                    assert_eq!(plain.values.vector(sample), repaired.values.vector(sample));
                    continue;
                }
                let around = [
                    at(x - 1, y, z),
                    at(x + 1, y, z),
                    at(x, y - 1, z),
                    at(x, y + 1, z),
                    at(x, y, z - 1),
                    at(x, y, z + 1),
                ];
                let outside: Vec<usize> = around.into_iter().filter(|n| !plain.inside[*n]).collect();
                if outside.is_empty() {
                    continue;
                }
                checked += 1;
                for (k, value) in repaired.values.vector(sample).iter().enumerate() {
                    let mean = outside.iter().map(|n| plain.values.vector(*n)[k]).sum::<f64>() / outside.len() as f64;
                    assert!((value - mean).abs() < 1e-12 * (1.0 + mean.abs()), "{value} for {mean}");
                }
            }
        }
    }
    assert!(checked > 5, "{checked}");
}

/// Among cells of different size neighbours are the ends of cells' edges.
#[test]
fn dilation_in_trees_and_nested_grids() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let around = prober(&lights, Some(&transport), Probes::Traced { effort: Effort::Samples(32), seed: 1 });
    for structure in [
        format!(
            "octree = {{ {BOX}, min_level = 2, max_level = 4, heuristic = \"contains_geometry\", interpolation = \"half_gradient\""
        ),
        format!("two_level = {{ {BOX}, samples = [5, 5, 5], inner = 3, interpolation = \"half_gradient\""),
    ] {
        let with = |repair: bool| {
            bake(&Volume::inline(&format!("{structure}, repair = {repair} }}")).unwrap(), &around).unwrap()
        };
        let (plain, repaired) = (with(false), with(true));
        // inside, as the block's own coordinates say
        let (low, high) = (DVec3::new(-0.7, -0.4, -0.5), DVec3::new(-0.1, 0.2, 0.1));
        for (place, inside) in plain.places.iter().zip(&plain.inside) {
            let p = plain.bounds.world(*place);
            assert_eq!(*inside, p.cmpgt(low).all() && p.cmplt(high).all(), "{structure}: {p}");
        }
        let mut neighbours: HashMap<u32, BTreeSet<u32>> = HashMap::new();
        for cell in &cells(&plain).cells {
            for (a, b) in (0..8usize).flat_map(|a| (0..8usize).map(move |b| (a, b))) {
                if (a ^ b).count_ones() == 1 {
                    neighbours.entry(cell.corners[a]).or_default().insert(cell.corners[b]);
                }
            }
        }
        let (mut known, mut values) = (plain.inside.iter().map(|i| !i).collect::<Vec<_>>(), plain.values.clone());
        let mut rounds = 0;
        while known.contains(&false) {
            rounds += 1;
            let mut next = known.clone();
            for sample in (0..known.len()).filter(|s| !known[*s]) {
                let from: Vec<usize> =
                    neighbours[&(sample as u32)].iter().map(|n| *n as usize).filter(|n| known[*n]).collect();
                if from.is_empty() {
                    continue;
                }
                for k in 0..27 {
                    let sum: f64 = from.iter().map(|n| values.vector(*n)[k]).sum();
                    values.data[27 * sample + k] = sum / from.len() as f64;
                }
                next[sample] = true;
            }
            assert_ne!(known, next, "every sample is reached");
            known = next;
        }
        assert!(rounds > 1, "{structure}: some are reached by way of others");
        let scale = plain.values.data.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        for (a, b) in repaired.values.data.iter().zip(&values.data) {
            assert!((a - b).abs() < 1e-12 * scale, "{structure}: {a} for {b}");
        }
        let (slopes, own) = (repaired.slopes.as_ref().unwrap(), plain.slopes.as_ref().unwrap());
        for (sample, inside) in plain.inside.iter().enumerate() {
            let rows = 3 * 27 * sample..3 * 27 * (sample + 1);
            match inside {
                true => assert!(slopes.data[rows].iter().all(|slope| *slope == 0.0)),
                false => assert_eq!(slopes.data[rows.clone()], own.data[rows]),
            }
        }
        assert_eq!(repaired.counts.repaired, plain.inside.iter().filter(|inside| **inside).count() as u64);
        assert_eq!((plain.counts.repaired, plain.counts.inside), (0, repaired.counts.repaired));
    }
}
