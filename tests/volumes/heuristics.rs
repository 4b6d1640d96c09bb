//! Every heuristic against a second computation: a tree that is built here, by other means, must have the same cells.

use std::collections::{BTreeSet, HashMap};

use glam::DVec3;
use rigbench::light::Light;
use rigbench::probe::{Prober, Probes, SampleRequest, depths, texels};
use rigbench::trace::{Effects, Effort, Tracer, Transport};
use rigbench::volume::{BakedVolume, Volume, bake};

use super::{BOX, block, cells, lights, prober, surroundings};

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
}

impl<'a> Field<'a> {
    /// The mean is over the corners of the cells of the least level.
    fn new(prober: &'a Prober<'a>, least: &BTreeSet<Cube>) -> Self {
        let mut field = Self { prober, known: HashMap::new(), mean: 0.0 };
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
        rms(value).max(0.01 * self.mean)
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
        apart(&self.between(cube, [0.5; 3]), &truth) > threshold * self.local(&truth)
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
    let mut either = octree("error", 1, "");
    if let rigbench::volume::Structure::Octree { heuristic, .. } = &mut either.structure {
        use rigbench::volume::Criterion;
        heuristic.any = vec![Criterion::Error { threshold: 0.1 }, Criterion::Gradient { threshold: 0.9 }];
    }
    let volume = bake(&either, &around).unwrap();
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

    let with = |criterion: rigbench::volume::Criterion| {
        let mut volume = octree("error", 1, "");
        if let rigbench::volume::Structure::Octree { heuristic, .. } = &mut volume.structure {
            heuristic.any = vec![criterion];
        }
        bake(&volume, &around).unwrap()
    };
    use rigbench::volume::{Criterion, Evidence};
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
