//! How objects read volumes, by computations that know no lookup code; and continuity where cells meet at edges and corners.

use std::sync::Arc;

use glam::DVec3;
use rigbench::candidate::{Arithmetic, Reading, Surroundings, along_path, prepare_volume};
use rigbench::math::{Rgb, Vector3};
use rigbench::rig::{LocalPoints, Packed, RigModel, plain_irradiance};
use rigbench::scene::{Mesh, OrientedBox, SurfacePoint};
use rigbench::volume::{Across, BakedVolume, CellModel, Layout, VolumeModel};

use super::{BOX, baked, filled, octree, places, value};

fn arc(volume: &BakedVolume) -> Arc<rigbench::volume::Cells> {
    match &volume.layout {
        Layout::Cells(cells) => cells.clone(),
        Layout::Grid(_) | Layout::Path(_) => panic!("no cells"),
    }
}

/// All cells that a place touches must agree there: over faces, edges and corners, whatever the sizes that meet.
#[test]
fn cells_agree_wherever_they_touch() {
    for interpolation in ["trilinear", "gradient_corrected", "half_gradient", "tricubic"] {
        let volume = baked(&octree(&format!("interpolation = \"{interpolation}\"")));
        let vectors = volume.vectors();
        let mean = vectors.data.iter().map(|v| v.abs()).sum::<f64>() / vectors.data.len() as f64;
        let cells = arc(&volume);
        let largest = |across: Across| {
            let model = CellModel::<f64>::new(cells.clone(), volume.volume.interpolation, across);
            let at = |cell: usize, q: DVec3| {
                let mut sum = vec![0.0; vectors.stride()];
                model.taps_of_cell(cell, Vector3::of(q), &mut |vector, weight| {
                    sum.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += weight * v);
                });
                sum
            };
            let span = |cell: usize| {
                let cell = &cells.cells[cell];
                [cell.low, cell.low.map(|u| u + cell.size)].map(|place| DVec3::from_array(cells.position(place)))
            };
            let (mut most, mut three_sizes) = (0.0f64, 0);
            for (index, cell) in cells.cells.iter().enumerate() {
                let [low, high] = span(index);
                let touching: Vec<usize> = (0..cells.cells.len())
                    .filter(|other| {
                        let (a, b) = (&cells.cells[*other], cell);
                        *other != index
                            && (0..3).all(|i| a.low[i] <= b.low[i] + b.size && b.low[i] <= a.low[i] + a.size)
                    })
                    .collect();
                let sizes: std::collections::BTreeSet<u32> =
                    touching.iter().map(|other| cells.cells[*other].size).chain([cell.size]).collect();
                three_sizes += usize::from(sizes.len() == 3);
                // corners, places on edges and places on faces: coordinates 0, 1 or something between
                for k in 0..64u32 {
                    let share: [f64; 3] = std::array::from_fn(|a| [0.0, 1.0, 0.5, 0.2871][(k >> (2 * a) & 3) as usize]);
                    if share.iter().all(|s| *s > 0.0 && *s < 1.0) {
                        continue;
                    }
                    let q = low + (high - low) * DVec3::from_array(share);
                    let own = at(index, q);
                    for other in &touching {
                        let [from, to] = span(*other);
                        let air = DVec3::splat(1e-12);
                        if q.cmpge(from - air).all() && q.cmple(to + air).all() {
                            let far = own.iter().zip(at(*other, q)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                            most = most.max(far / mean);
                        }
                    }
                }
            }
            assert!(three_sizes > 0, "somewhere a cell has coarser and finer neighbours");
            most
        };
        assert!(largest(Across::Continuous) < 1e-11, "{interpolation}: {}", largest(Across::Continuous));
        assert!(largest(Across::Naive) > 1e-4, "{interpolation}: cells by their own corners alone must not agree");
    }
}

/// What jumps within one level: the nearest sample by all of the difference between two, inverse distances a little, others not at all.
#[test]
fn jumps_of_grids_by_each_interpolation() {
    let jump = |interpolation: &str| {
        let table = format!("grid = {{ {BOX}, samples = [4, 3, 4], interpolation = \"{interpolation}\" }}");
        (baked(&table), baked(&table).face_jump().unwrap())
    };
    for smooth in ["trilinear", "gradient_corrected", "half_gradient", "tricubic"] {
        assert!(jump(smooth).1.all < 1e-12, "{smooth}");
    }
    assert!(jump("inverse_distance").1.all > 1e-3);
    let (volume, found) = jump("nearest");
    let rms =
        |values: Vec<f64>| rigbench::volume::rms_over_normals(&values, rigbench::sh::Lobe::<f64>::lambert().bands());
    let vector = |i: usize| volume.values.vector(i).to_vec();
    let mean = (0..48).map(|i| rms(vector(i))).sum::<f64>() / 48.0;
    let mut largest = 0.0f64;
    for (a, b) in (0..48).flat_map(|i| {
        let [x, y, z] = [i % 4, i / 4 % 3, i / 12];
        [(x < 3, 1), (y < 2, 4), (z < 3, 12)].into_iter().filter(|(is, _)| *is).map(move |(_, step)| (i, i + step))
    }) {
        let apart = vector(a).iter().zip(vector(b)).map(|(a, b)| a - b).collect();
        largest = largest.max(rms(apart) / mean);
    }
    assert!((found.all - largest).abs() < 1e-12 && largest > 0.1, "{found:?} for {largest}");
}

/// Faces between levels by a search through all pairs of cells, each cell by its own eight corners: where these are straight, two cells
/// differ most at a corner of what they share.
#[test]
fn the_largest_jump_across_a_face_by_all_pairs_of_cells() {
    use std::collections::HashMap;
    let volume = baked(&octree("interpolation = \"trilinear\", across = \"naive\""));
    let bands = rigbench::sh::Lobe::<f64>::lambert().bands().to_vec();
    let rms = |values: &[f64]| rigbench::volume::rms_over_normals(values, &bands);
    let sample_at: HashMap<[u64; 3], usize> =
        volume.places.iter().enumerate().map(|(i, place)| (place.map(f64::to_bits), i)).collect();
    let boxes = volume.cell_boxes();
    let own = |[low, high]: &[[f64; 3]; 2], q: [f64; 3]| -> Vec<f64> {
        let mut sum = vec![0.0; 27];
        for k in 0..8usize {
            let corner: [f64; 3] = std::array::from_fn(|a| if k >> a & 1 == 1 { high[a] } else { low[a] });
            let weight: f64 = (0..3)
                .map(|a| {
                    let share = (q[a] - low[a]) / (high[a] - low[a]);
                    if k >> a & 1 == 1 { share } else { 1.0 - share }
                })
                .product();
            let sample = volume.values.vector(sample_at[&corner.map(f64::to_bits)]);
            sum.iter_mut().zip(sample).for_each(|(s, v)| *s += weight * v);
        }
        sum
    };
    let mut largest = 0.0f64;
    for (k, a) in boxes.iter().enumerate() {
        for b in &boxes[..k] {
            let shared: [[f64; 2]; 3] = std::array::from_fn(|i| [a[0][i].max(b[0][i]), a[1][i].min(b[1][i])]);
            let flat = shared.iter().filter(|[low, high]| low == high).count();
            if flat != 1 || shared.iter().any(|[low, high]| low > high) {
                continue;
            }
            for corner in 0..8usize {
                let q = std::array::from_fn(|i| shared[i][corner >> i & 1]);
                let apart: Vec<f64> = own(a, q).iter().zip(own(b, q)).map(|(a, b)| a - b).collect();
                largest = largest.max(rms(&apart));
            }
        }
    }
    let mean = (0..volume.places.len()).map(|i| rms(volume.values.vector(i))).sum::<f64>() / volume.places.len() as f64;
    let found = volume.face_jump().unwrap();
    assert!((found.all / (largest / mean) - 1.0).abs() < 1e-9, "{found:?} for {}", largest / mean);
    assert!(largest > 0.0 && found.between_levels == found.all);
}

fn quad_mesh() -> Mesh {
    Mesh {
        positions: vec![
            DVec3::new(-0.5, 0.1, -0.3),
            DVec3::new(0.6, 0.2, -0.2),
            DVec3::new(0.5, 0.0, 0.7),
            DVec3::new(-0.4, 0.3, 0.6),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: vec![[DVec3::Y; 3]; 2],
    }
}

fn on_mesh(mesh: &Mesh) -> Vec<SurfacePoint> {
    let mut points = Vec::new();
    for (k, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
        for step in 0..40 {
            let (u, v) = ((0.754_877_7 * f64::from(step)).fract(), (0.569_840_3 * f64::from(step)).fract());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let normal = DVec3::new(0.1 * k as f64 + u, 1.0, v - 0.5).normalize();
            points.push(SurfacePoint { position: a + (b - a) * u + (c - a) * v, normal });
        }
    }
    points
}

fn irradiance(volume: &BakedVolume, bounds: OrientedBox, reading: Reading, points: &[SurfacePoint]) -> Vec<Rgb<f64>> {
    let around = Surroundings { bounds, lights: &[], wrap: 0.0, transport: None };
    let lit = prepare_volume(&Arc::new(volume.clone()), Arithmetic::CpuF64, &around, reading, None).unwrap();
    lit.irradiance(points).unwrap()
}

/// E of a field whose coefficients are all f(p): f times the sum of A_l Y_i(n).
fn of_field(f: f64, n: DVec3) -> f64 {
    let mut vectors = rigbench::rig::ShVectors::<f64>::zeros(3, 1);
    vectors.data.fill(f);
    let vectors = vectors.convolved(rigbench::sh::Lobe::<f64>::lambert().bands());
    let y = rigbench::sh::basis::<f64, 9>(Vector3::of(n));
    (0..9).map(|i| vectors.data[3 * i] * y[i]).sum()
}

type Field = fn(DVec3) -> f64;

#[test]
fn once_an_object_once_a_vertex_and_at_every_point() {
    let linear: Field = |p| 1.0 + 0.4 * p.x - 0.3 * p.y + 0.2 * p.z;
    let slope = |_: DVec3| DVec3::new(0.4, -0.3, 0.2);
    let square: Field = |p| 1.0 + p.x * p.x;
    let square_slope = |p: DVec3| DVec3::new(2.0 * p.x, 0.0, 0.0);
    let mesh = quad_mesh();
    let points = on_mesh(&mesh);
    let bounds = OrientedBox::aligned(DVec3::new(-0.5, 0.0, -0.3), DVec3::new(0.6, 0.3, 0.7));
    let reading = Reading { mesh: Some(&mesh), frames: 1, ..Reading::default() };
    let structures = [
        format!("grid = {{ {BOX}, samples = [4, 3, 5]"),
        format!("two_level = {{ {BOX}, samples = [4, 3, 5], inner = 2"),
        format!("octree = {{ {BOX}, min_level = 1, max_level = 3, heuristic = \"error\""),
    ];
    for structure in &structures {
        for lookup in ["per_point", "per_vertex", "per_object"] {
            for interpolation in ["trilinear", "half_gradient", "tricubic"] {
                let table = format!("{structure}, lookup = \"{lookup}\", interpolation = \"{interpolation}\" }}");
                let volume = filled(baked(&table), linear, slope);
                let center = volume.bounds.center;
                for (point, e) in points.iter().zip(irradiance(&volume, bounds, reading, &points)) {
                    // straight fields are exact whichever way they are read
                    let expected = of_field(linear(point.position - center), point.normal);
                    assert!((e.g - expected).abs() < 1e-10, "{table}: {} for {expected}", e.g);
                }
                // a field that bends shows how it is read
                let volume = filled(baked(&table), square, square_slope);
                let vectors = volume.vectors();
                let read = |p: DVec3| value(&volume, &vectors, volume.bounds.local(p))[0];
                for (k, (point, e)) in points.iter().zip(irradiance(&volume, bounds, reading, &points)).enumerate() {
                    let expected = match lookup {
                        "per_point" => read(point.position),
                        "per_vertex" => {
                            // barycentric weights by areas
                            let [a, b, c] = mesh.triangles[k / 40].map(|i| mesh.positions[i as usize]);
                            let p = point.position;
                            let area = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a).length();
                            let whole = area(a, b, c);
                            (area(p, b, c) * read(a) + area(a, p, c) * read(b) + area(a, b, p) * read(c)) / whole
                        }
                        _ => {
                            let q = volume.bounds.local(bounds.center);
                            let [value, x, y, z] = volume.value_and_slopes(q.to_array());
                            let d = point.position - bounds.center;
                            value[0] + x[0] * d.x + y[0] * d.y + z[0] * d.z
                        }
                    };
                    let expected = of_field(expected, point.normal);
                    assert!((e.g - expected).abs() < 1e-6, "{table}: {} for {expected}", e.g);
                }
            }
        }
    }
}

/// One sample an object: of the nearest its value and its own derivatives.
#[test]
fn the_nearest_sample_brings_its_own_derivatives() {
    let table =
        format!("grid = {{ {BOX}, samples = [3, 3, 3], interpolation = \"nearest\", lookup = \"per_object\" }}");
    let square: Field = |p| 1.0 + p.x * p.x;
    let volume = filled(baked(&table), square, |p| DVec3::new(2.0 * p.x, 0.0, 0.0));
    let half = volume.bounds.half[0];
    // a little nearer to the outer sample than to the middle one
    let [value, x, ..] = volume.value_and_slopes([0.55 * half, 0.01, -0.02]);
    assert_eq!((value[0], x[0]), (1.0 + half * half, 2.0 * half));
    let [value, x, ..] = volume.value_and_slopes([0.45 * half, 0.01, -0.02]);
    assert_eq!((value[0], x[0]), (1.0, 0.0));
}

/// Smoothing goes its share of the way each frame: after a step of the nearest sample what is left shrinks by 1 - s a frame.
#[test]
fn smoothing_spreads_a_step_over_frames() {
    let smoothing = 0.3;
    let table = format!(
        "grid = {{ {BOX}, samples = [2, 2, 2], interpolation = \"nearest\", lookup = \"per_object\", smoothing = {smoothing} }}"
    );
    let volume = filled(baked(&table), |p| if p.x > 0.0 { 5.0 } else { 1.0 }, |_| DVec3::ZERO);
    let centre = volume.bounds.center;
    let places: Vec<DVec3> = (0..20).map(|k| centre + DVec3::X * (0.1 * f64::from(k) - 0.95)).collect();
    let volumes = [Arc::new(volume)];
    let seen = along_path(&volumes, &places, 0);
    let [volume] = volumes;
    let first = places.iter().position(|p| p.x > centre.x).unwrap();
    for (k, vector) in seen.iter().enumerate() {
        let left = if k < first { 1.0 } else { (1.0f64 - smoothing).powi((k - first + 1) as i32) };
        let expected = 5.0 - 4.0 * left;
        assert!((vector[0] - expected).abs() < 1e-12, "{k}: {} for {expected}", vector[0]);
    }
    // and what a receiver reads in a frame, after the frames before it, is the same
    let object = |p: &DVec3| OrientedBox::aligned(*p - DVec3::splat(0.1), *p + DVec3::splat(0.1));
    let before: Vec<OrientedBox> = places[..first + 2].iter().map(object).collect();
    let reading = Reading { before: &before, frames: places.len(), ..Reading::default() };
    let now = places[first + 2];
    let point = SurfacePoint { position: now, normal: DVec3::Y };
    let e = irradiance(&volume, object(&now), reading, &[point])[0];
    let expected = of_field(seen[first + 2][0], DVec3::Y);
    assert!((e.g - expected).abs() < 1e-10, "{} for {expected}", e.g);
    // where every frame has a volume of its own, each was read in its frame
    let brighter: Vec<Arc<BakedVolume>> =
        (0..places.len()).map(|k| Arc::new(filled((*volume).clone(), |_| 1.0 + k as f64, |_| DVec3::ZERO))).collect();
    let frame = first + 2;
    let reading = Reading { volumes_before: &brighter[..frame], ..reading };
    let e = irradiance(&brighter[frame], object(&now), reading, &[point])[0];
    let expected = of_field(along_path(&brighter, &places, 0)[frame][0], DVec3::Y);
    assert!((e.g - expected).abs() < 1e-10, "{} for {expected}", e.g);
}

/// Where lights move a walk reads the volumes of its time, evenly from frame to frame.
#[test]
fn a_walk_goes_with_the_time_of_moving_lights() {
    let table = format!("grid = {{ {BOX}, samples = [2, 2, 2] }}");
    let volumes = [1.0, 3.0, 2.0].map(|field| Arc::new(filled(baked(&table), |_| field, |_| DVec3::ZERO)));
    let centre = volumes[0].bounds.center;
    let places: Vec<DVec3> = (0..41).map(|k| centre + DVec3::X * (0.04 * f64::from(k) - 0.8)).collect();
    let seen = along_path(&volumes, &places, 0);
    for (k, vector) in seen.iter().enumerate() {
        let expected = if k <= 20 { 1.0 + k as f64 / 10.0 } else { 3.0 - (k - 20) as f64 / 20.0 };
        assert!((vector[0] - expected).abs() < 1e-12, "{k}: {} for {expected}", vector[0]);
    }
    assert!(along_path(&volumes[..1], &places, 0).iter().all(|vector| (vector[0] - 1.0).abs() < 1e-12));
}

/// The registers' sums against the plain loop, and a grid as cells against the grid.
#[test]
fn fast_lookups_are_the_plain_ones() {
    let mut points = LocalPoints::<f32>::default();
    for (k, q) in places(803, [1.1, 0.8, 1.1]).enumerate() {
        points.push(q, DVec3::new((k as f64).sin(), (k as f64).cos(), 0.3).normalize());
    }
    for interpolation in ["trilinear", "half_gradient", "tricubic", "gradient_corrected"] {
        for table in [
            octree(&format!("interpolation = \"{interpolation}\"")),
            format!("two_level = {{ {BOX}, samples = [4, 3, 5], inner = 3, interpolation = \"{interpolation}\" }}"),
            format!("grid = {{ {BOX}, samples = [4, 3, 5], interpolation = \"{interpolation}\" }}"),
        ] {
            let volume = baked(&table);
            let model: VolumeModel<f32> = volume.model();
            let vectors = volume.vectors().rounded::<f32>().convolved(rigbench::sh::Lobe::<f32>::lambert().bands());
            let (mut plain, mut fast) = (vec![Rgb::zero(); points.len()], vec![Rgb::zero(); points.len()]);
            plain_irradiance::<f32, _, 9>(&model, &vectors, &points, &mut plain);
            let scale = plain.iter().fold(0.0f32, |m, e| m.max(e.max_abs()));
            model.packed_irradiance::<9>(&Packed::new(vectors.clone()), &points, &mut fast);
            let apart =
                |a: &[Rgb<f32>]| a.iter().zip(&plain).map(|(a, b)| (*a - *b).max_abs() / scale).fold(0.0, f32::max);
            assert!(apart(&fast) < 3e-6, "{table}: {}", apart(&fast));
            let wrong: Vec<Rgb<f32>> = fast.iter().map(|e| *e * 1.0001).collect();
            assert!(apart(&wrong) > 3e-6);
        }
    }
}
