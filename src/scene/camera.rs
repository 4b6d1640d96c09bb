use glam::DVec3;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub eye: DVec3,
    /// Unit vectors: right, up and forward, at right angles.
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
    /// Vertical field of view, radians.
    pub fov_y: f64,
}

impl Camera {
    /// A camera at `eye` that looks at `target`; `None` where eye and target coincide or `up` is along the view.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3, fov_y_degrees: f64) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        let right = forward.cross(up.try_normalize()?);
        let right = (right.length() > 1e-9).then(|| right.normalize())?;
        Some(Self { eye, right, up: right.cross(forward), forward, fov_y: fov_y_degrees.to_radians() })
    }

    /// The picture's places of `width` x `height` pixels in the world.
    pub fn raster(&self, width: usize, height: usize) -> Raster {
        let per_pixel = 2.0 * (0.5 * self.fov_y).tan() / height as f64;
        let corner =
            self.forward - self.right * (0.5 * width as f64 * per_pixel) + self.up * (0.5 * height as f64 * per_pixel);
        Raster { corner, across: self.right * per_pixel, down: -self.up * per_pixel }
    }

    /// Where a place of the world lies in such a picture: pixels from the left and from the top. `None` for what is not before the eye.
    pub fn seen_at(&self, p: DVec3, width: usize, height: usize) -> Option<[f64; 2]> {
        let per_pixel = 2.0 * (0.5 * self.fov_y).tan() / height as f64;
        let to = p - self.eye;
        let depth = to.dot(self.forward);
        let [x, y] = [to.dot(self.right), -to.dot(self.up)].map(|v| v / (depth * per_pixel));
        (depth > 1e-6 * to.length()).then_some([x + 0.5 * width as f64, y + 0.5 * height as f64])
    }
}

/// A picture plane one metre before the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raster {
    /// From the eye to the top left corner.
    corner: DVec3,
    /// One pixel to the right, and one down.
    across: DVec3,
    down: DVec3,
}

impl Raster {
    /// The direction (not unit: 1 m forwards) through a place: x pixels from the left, y from the top.
    #[inline(always)]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.corner + self.across * x + self.down * y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_stands_upright_and_spans_the_field_of_view() {
        let camera = Camera::looking_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 60.0).unwrap();
        let raster = camera.raster(320, 180);
        assert!((raster.direction(160.0, 90.0) - DVec3::NEG_Z).length() < 1e-15);
        let top = raster.direction(160.0, 0.0).normalize();
        assert!((top.y.asin().to_degrees() - 30.0).abs() < 1e-9, "{top}");
        for [x, y] in [[12.5, 90.0], [300.25, 3.0]] {
            let seen = camera.seen_at(camera.eye + 7.0 * raster.direction(x, y), 320, 180).unwrap();
            assert!((seen[0] - x).abs() < 1e-9 && (seen[1] - y).abs() < 1e-9, "{seen:?}");
        }
        assert_eq!(camera.seen_at(DVec3::new(0.0, 0.0, 6.0), 320, 180), None);
        let right = raster.direction(320.0, 90.0);
        assert!(right.x > 0.0 && (right.x / -right.z - 320.0 / 180.0 * 30f64.to_radians().tan()).abs() < 1e-12);
        assert!(Camera::looking_at(DVec3::ONE, DVec3::ONE, DVec3::Y, 60.0).is_none());
        assert!(Camera::looking_at(DVec3::Y, DVec3::ZERO, DVec3::Y, 60.0).is_none());
    }
}
