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

    /// The unit direction through a place of the image: x from 0 (left) to `width`, y from 0 (top) to `height`, pixels.
    pub fn direction(&self, x: f64, y: f64, width: usize, height: usize) -> DVec3 {
        let per_pixel = 2.0 * (0.5 * self.fov_y).tan() / height as f64;
        let (across, above) = (per_pixel * (x - 0.5 * width as f64), per_pixel * (0.5 * height as f64 - y));
        (self.forward + self.right * across + self.up * above).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_stands_upright_and_spans_the_field_of_view() {
        let camera = Camera::looking_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 60.0).unwrap();
        assert!((camera.direction(160.0, 90.0, 320, 180) - DVec3::NEG_Z).length() < 1e-15);
        let top = camera.direction(160.0, 0.0, 320, 180);
        assert!((top.y.asin().to_degrees() - 30.0).abs() < 1e-9, "{top}");
        let right = camera.direction(320.0, 90.0, 320, 180);
        assert!(right.x > 0.0 && (right.x / -right.z - 320.0 / 180.0 * 30f64.to_radians().tan()).abs() < 1e-12);
        assert!(Camera::looking_at(DVec3::ONE, DVec3::ONE, DVec3::Y, 60.0).is_none());
        assert!(Camera::looking_at(DVec3::Y, DVec3::ZERO, DVec3::Y, 60.0).is_none());
    }
}
