//! What a volume costs: lookups of octrees beside grids, each by the loop that `rigbench run` times, one core, f32; and a bake of many
//! samples with the memory that it takes. `cargo bench --bench volume`. Ratios are taken in one run, the subjects in turn.

use std::hint::black_box;
use std::time::Instant;

use glam::DVec3;
use rigbench::light::{Light, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{GradientSource, Prober, Probes};
use rigbench::rig::{LocalPoints, Packed, RigModel};
use rigbench::scene::OrientedBox;
use rigbench::sh::Window;
use rigbench::volume::{BakedVolume, Volume, VolumeModel, bake};

/// Few a round, so that a round is seldom interrupted on a machine that does other work.
const POINTS: usize = 1 << 14;
const ROUNDS: usize = 201;
/// How many times a grid's time a continuous octree may take.
const MOST: f64 = 3.0;

fn room() -> OrientedBox {
    OrientedBox::aligned(DVec3::splat(-1.0), DVec3::splat(1.0))
}

fn baked(table: &str) -> BakedVolume {
    let sphere = |x: f64, y: f64, z: f64| {
        Light::Sphere(Sphere { center: Vector3::new(x, y, z), radius: 0.2, radiance: Rgb::new(9.0, 6.0, 3.0) })
    };
    let lights = [sphere(1.2, 1.2, 1.2), sphere(-3.0, 1.0, 0.4)];
    let prober = Prober {
        bounds: room(),
        order: 3,
        lights: &lights,
        transport: None,
        device: None,
        probes: Probes::Analytic,
        gradients: GradientSource::Analytic,
        window: Window::None,
    };
    bake(&Volume::inline(table).expect("a valid table"), &prober).expect("within its budget")
}

struct Subject {
    name: &'static str,
    model: VolumeModel<f32>,
    vectors: Packed<f32>,
    samples: usize,
    nanoseconds: Vec<f64>,
}

impl Subject {
    fn new(name: &'static str, table: &str) -> Self {
        let volume = baked(table);
        Self {
            name,
            model: volume.model(),
            vectors: Packed::new(volume.vectors().rounded()),
            samples: volume.places.len(),
            nanoseconds: Vec::new(),
        }
    }

    fn round(&mut self, points: &LocalPoints<f32>, out: &mut [Rgb<f32>]) {
        // what the subject before left in the caches is not this one's cost
        self.model.packed_irradiance::<9>(&self.vectors, black_box(points), out);
        black_box(&mut *out);
        let start = Instant::now();
        self.model.packed_irradiance::<9>(&self.vectors, black_box(points), out);
        black_box(out);
        self.nanoseconds.push(start.elapsed().as_secs_f64() * 1e9 / points.len() as f64);
    }

    fn median(&self) -> f64 {
        let mut sorted = self.nanoseconds.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }
}

/// Largest resident memory of this process so far, MB; where the system says.
fn peak_megabytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

fn main() {
    let bounds = "bounds = { min = [-1, -1, -1], max = [1, 1, 1] }";
    let octree = |across: &str, interpolation: &str| {
        format!(
            "octree = {{ {bounds}, min_level = 1, max_level = 6, heuristic = \"gradient\", across = \"{across}\", \
             interpolation = \"{interpolation}\" }}"
        )
    };
    let mut stream = Stream::indexed(41, StreamPurpose::Test, 0);
    let mut points = LocalPoints::<f32>::default();
    for _ in 0..POINTS {
        let q = DVec3::from_array([(); 3].map(|()| stream.uniform_between(-1.0, 1.0)));
        points.push(q, stream.direction());
    }
    let mut out = vec![Rgb::zero(); POINTS];
    let mut subjects = [
        Subject::new("grid, trilinear", &format!("grid = {{ {bounds}, samples = [17, 17, 17] }}")),
        Subject::new("octree naive, trilinear", &octree("naive", "trilinear")),
        Subject::new("octree continuous, trilinear", &octree("continuous", "trilinear")),
        Subject::new(
            "grid, half gradient",
            &format!("grid = {{ {bounds}, samples = [17, 17, 17], interpolation = \"half_gradient\" }}"),
        ),
        Subject::new("octree continuous, half gradient", &octree("continuous", "half_gradient")),
    ];
    for _ in 0..ROUNDS {
        for subject in &mut subjects {
            subject.round(&points, &mut out);
        }
    }
    let base = |interpolation: &str| {
        let grid = subjects.iter().find(|s| s.name == format!("grid, {interpolation}")).expect("a subject");
        grid.median()
    };
    for subject in &subjects {
        let own = base(subject.name.split_once(", ").expect("a comma").1);
        let ratio = subject.median() / own;
        let verdict = match subject.name.contains("continuous") {
            true if ratio <= MOST => format!(" (at most {MOST}) ok"),
            true => format!(" (at most {MOST}) MISSED"),
            false => String::new(),
        };
        println!(
            "{:34} {:6} samples {:8.1} ns a point, {ratio:.2} times its grid{verdict}",
            subject.name,
            subject.samples,
            subject.median(),
        );
    }
    let before = peak_megabytes();
    let start = Instant::now();
    let volume = baked(&format!(
        "grid = {{ {bounds}, samples = [47, 47, 46], interpolation = \"half_gradient\", budget = 200000 }}"
    ));
    let after = peak_megabytes();
    print!("bake of {} samples: {:.2} s", volume.places.len(), start.elapsed().as_secs_f64());
    if let (Some(before), Some(after)) = (before, after) {
        print!(", {:.0} MB kept, at most {:.0} MB more than before", volume.bytes() as f64 / 5e5, after - before);
    }
    println!();
}
