//! A quick look at a scene: its camera's picture as PNG, normals shaded by a head light and a sky.
//!
//! `cargo run --release --example look -- scenes/car.toml car.png [FRAME [WIDTH HEIGHT]]`

use std::path::Path;

use rigbench::scene::{Pixels, Scene};

fn main() -> anyhow::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [scene, picture, rest @ ..] = words.as_slice() else {
        anyhow::bail!("usage: look SCENE.toml PICTURE.png [FRAME [WIDTH HEIGHT]]");
    };
    let number = |i: usize, default: u32| rest.get(i).map_or(Ok(default), |word| word.parse());
    let (frame, width, height) = (number(0, 0)?, number(1, 640)?, number(2, 360)?);
    let scene = Scene::load(Path::new(scene))?;
    let camera = scene.camera.ok_or_else(|| anyhow::anyhow!("the scene has no camera"))?;
    let pixels = Pixels::cast(&scene, frame as usize, width as usize, height as usize);
    let mut image = image::RgbImage::from_pixel(width, height, image::Rgb([24, 26, 32]));
    for hit in &pixels.hits {
        let towards_eye = (camera.eye - hit.point.position).normalize();
        let light = 0.15 + 0.5 * hit.point.normal.dot(towards_eye).max(0.0) + 0.35 * (0.5 + 0.5 * hit.point.normal.y);
        let shade = hit.albedo.map(|a| ((a * light).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8);
        image.put_pixel(hit.pixel % width, hit.pixel / width, image::Rgb(shade));
    }
    image.save(picture)?;
    for receiver in &scene.receivers {
        let bounds = receiver.oriented_box(frame as usize);
        println!(
            "{}: {} vertices, centre {:.3}, half extents {:.3?}, half diagonal {:.3} m",
            receiver.name,
            receiver.vertex_count(),
            bounds.center,
            bounds.half,
            bounds.half_diagonal()
        );
    }
    Ok(())
}
