use glam::{DAffine3, DMat3, DVec3};

/// An object's place: M = T Rz Ry Rx S, right to left: scale, rotate about x, then y, then z, translate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Factors along the object's axes, none 0; an odd number of negative ones mirrors the object.
    pub scale: DVec3,
    /// Angles about x, y and z, degrees.
    pub rotate: DVec3,
    /// Metres.
    pub translate: DVec3,
}

impl Default for Transform {
    fn default() -> Self {
        Self { scale: DVec3::ONE, rotate: DVec3::ZERO, translate: DVec3::ZERO }
    }
}

impl Transform {
    pub fn world_from_object(&self) -> DAffine3 {
        let linear = rotation(2, self.rotate.z)
            * rotation(1, self.rotate.y)
            * rotation(0, self.rotate.x)
            * DMat3::from_diagonal(self.scale);
        DAffine3 { matrix3: linear, translation: self.translate }
    }
}

/// Right-handed rotation about a coordinate axis by an angle in degrees.
fn rotation(axis: usize, degrees: f64) -> DMat3 {
    let (sin, cos) = sin_cos_degrees(degrees);
    let mut columns = [[0.0; 3]; 3];
    let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
    columns[axis][axis] = 1.0;
    columns[next][next] = cos;
    columns[next][last] = sin;
    columns[last][next] = -sin;
    columns[last][last] = cos;
    DMat3::from_cols_array_2d(&columns)
}

/// Sine and cosine of an angle in degrees, exact at multiples of 90: a flat thing turned upright stays flat.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    let turn = degrees.rem_euclid(360.0);
    let quarter = (turn / 90.0).round();
    let (sin, cos) = (turn - 90.0 * quarter).to_radians().sin_cos();
    match quarter as u32 % 4 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_is_scale_then_x_then_y_then_z_then_translate() {
        let transform = Transform {
            scale: DVec3::new(2.0, 3.0, 4.0),
            rotate: DVec3::new(30.0, 50.0, -70.0),
            translate: DVec3::new(1.0, -2.0, 0.5),
        };
        let p = DVec3::new(0.3, -0.7, 1.1);
        let stepwise = DMat3::from_rotation_z(-70f64.to_radians())
            * (DMat3::from_rotation_y(50f64.to_radians())
                * (DMat3::from_rotation_x(30f64.to_radians()) * (p * transform.scale)))
            + transform.translate;
        let got = transform.world_from_object().transform_point3(p);
        assert!((got - stepwise).length() < 1e-14, "{got} for {stepwise}");
        let other_order = DMat3::from_rotation_x(30f64.to_radians())
            * (DMat3::from_rotation_y(50f64.to_radians())
                * (DMat3::from_rotation_z(-70f64.to_radians()) * (p * transform.scale)))
            + transform.translate;
        assert!((got - other_order).length() > 0.1, "the test must tell the orders apart");
    }

    #[test]
    fn quarter_turns_are_exact() {
        for (degrees, sin, cos) in [(90.0, 1.0, 0.0), (-90.0, -1.0, 0.0), (180.0, 0.0, -1.0), (450.0, 1.0, 0.0)] {
            let (got_sin, got_cos) = sin_cos_degrees(degrees);
            assert_eq!((got_sin, got_cos.abs()), (sin, f64::abs(cos)), "{degrees}");
        }
        for degrees in [-359.0, -44.9, 1e-3, 44.9, 45.1, 200.0, 1234.5] {
            let (sin, cos) = sin_cos_degrees(degrees);
            let angle = f64::to_radians(degrees);
            assert!((sin - angle.sin()).abs() < 1e-13 && (cos - angle.cos()).abs() < 1e-13, "{degrees}");
        }
    }
}
