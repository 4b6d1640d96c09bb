//! Pixel casting against the same rays through bare obvhs: `cargo bench --bench pixels`.
//!
//! Both are timed in turn in one process, on one thread and on all; the ratio is that of the medians. Bare obvhs gets its own best
//! tree over the triangles (spatial splits), its own triangle test, rays that lie ready in memory, and keeps the hits.

use std::path::Path;
use std::time::Instant;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use rigbench::scene::{Scene, View};

const WIDTH: usize = 960;
const HEIGHT: usize = 540;
const REPEATS: usize = 15;

struct Bare {
    bvh: CwBvh,
    leaves: Vec<RtTriangle>,
    rays: Vec<Ray>,
}

impl Bare {
    fn new(scene: &Scene, params: BvhBuildParams) -> Self {
        let mesh = scene.receivers[0].world_mesh(0).expect("a mesh");
        let single = |p: DVec3| p.as_vec3a();
        let triangles: Vec<Triangle> = (0..mesh.triangles.len())
            .map(|t| {
                let [v0, v1, v2]: [Vec3A; 3] = mesh.corners(t).map(single);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let bvh = build_cwbvh_from_tris(&triangles, params, &mut Default::default());
        let leaves = bvh.primitive_indices.iter().map(|i| RtTriangle::from(&triangles[*i as usize])).collect();
        let camera = scene.camera.expect("a camera");
        let raster = camera.raster(WIDTH, HEIGHT);
        let ray = |index: usize| {
            let direction = raster.direction((index % WIDTH) as f64 + 0.5, (index / WIDTH) as f64 + 0.5);
            Ray::new_inf(camera.eye.as_vec3a(), direction.as_vec3a())
        };
        Self { bvh, leaves, rays: (0..WIDTH * HEIGHT).map(ray).collect() }
    }

    fn replay(&self) -> Vec<RayHit> {
        let meet = |ray: &Ray| {
            let mut hit = RayHit::none();
            self.bvh.ray_traverse(*ray, &mut hit, |ray, leaf| self.leaves[leaf].intersect(ray));
            hit
        };
        let mut hits = vec![RayHit::none(); self.rays.len()];
        hits.par_chunks_mut(WIDTH).zip(self.rays.par_chunks(WIDTH)).for_each(|(hits, rays)| {
            hits.iter_mut().zip(rays).for_each(|(hit, ray)| *hit = meet(ray));
        });
        hits
    }
}

fn seconds<V>(work: impl Fn() -> V) -> f64 {
    let start = Instant::now();
    std::hint::black_box(work());
    start.elapsed().as_secs_f64()
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

fn main() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    println!("{WIDTH} x {HEIGHT} pixels, median of {REPEATS}; million rays a second");
    for name in ["car", "body", "head", "teapot"] {
        let scene = Scene::load(&scenes.join(format!("{name}.toml"))).expect("a shipped scene");
        let camera = scene.camera.expect("a camera");
        let view = View::new(&scene, 0);
        let bares = [BvhBuildParams::medium_build(), BvhBuildParams::slow_build()].map(|p| Bare::new(&scene, p));
        for threads in [1, std::thread::available_parallelism().map_or(1, usize::from)] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let (mut ours, mut theirs) = (Vec::new(), [Vec::new(), Vec::new()]);
                for _ in 0..REPEATS {
                    ours.push(seconds(|| view.cast(&camera, WIDTH, HEIGHT)));
                    for (samples, bare) in theirs.iter_mut().zip(&bares) {
                        samples.push(seconds(|| bare.replay()));
                    }
                }
                let hits = view.cast(&camera, WIDTH, HEIGHT).hits.len();
                let bare_hits = bares[0].replay().iter().filter(|hit| hit.t.is_finite()).count();
                let rate = |seconds: f64| (WIDTH * HEIGHT) as f64 / seconds / 1e6;
                let ours = median(ours);
                let theirs = theirs.map(median);
                let best = theirs[0].min(theirs[1]);
                println!(
                    "{name:>7}, {threads} thread(s): pixels {:.2}, bare obvhs {:.2} (medium build) {:.2} (slow build), ratio {:.3}; \
                     {hits} pixels hit, bare {bare_hits}",
                    rate(ours),
                    rate(theirs[0]),
                    rate(theirs[1]),
                    best / ours
                );
            });
        }
    }
}
