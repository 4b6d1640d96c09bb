use std::sync::LazyLock;

use glam::{DMat3, DVec3, Mat3, Vec3};

/// XYZ from linear RGB, and back, and the white point: Rec. 709 primaries and D65 as xy chromaticities (ITU-R BT.709, table 1).
struct Matrices {
    xyz_from_rgb: Mat3,
    rgb_from_xyz: Mat3,
    white: Vec3,
}

static MATRICES: LazyLock<Matrices> = LazyLock::new(|| {
    let xyz = |x: f64, y: f64| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
    let white = xyz(0.3127, 0.3290);
    let primaries = DMat3::from_cols(xyz(0.64, 0.33), xyz(0.30, 0.60), xyz(0.15, 0.06));
    let xyz_from_rgb = primaries * DMat3::from_diagonal(primaries.inverse() * white);
    Matrices {
        xyz_from_rgb: xyz_from_rgb.as_mat3(),
        rgb_from_xyz: xyz_from_rgb.inverse().as_mat3(),
        white: white.as_vec3(),
    }
});

/// YCxCz, the linear opponent space that the eye's contrast sensitivity is stated in (2020, section 4.1.1).
pub fn opponent_of_linear(rgb: [f32; 3]) -> [f32; 3] {
    let m = &*MATRICES;
    let v = m.xyz_from_rgb * Vec3::from_array(rgb) / m.white;
    [116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z)]
}

pub fn linear_of_opponent([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let m = &*MATRICES;
    let y = (y + 16.0) / 116.0;
    (m.rgb_from_xyz * (Vec3::new(y + cx / 500.0, y, y - cz / 200.0) * m.white)).to_array()
}

/// CIE L*a*b* of linear RGB with a* and b* scaled by 0.01 L*: colours look weaker in the dark (Hunt; 2020, equation 6).
pub fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    let m = &*MATRICES;
    const KNEE: f32 = 6.0 / 29.0;
    let f = |t: f32| if t > KNEE * KNEE * KNEE { t.cbrt() } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 };
    let v = m.xyz_from_rgb * Vec3::from_array(rgb) / m.white;
    let lightness = 116.0 * f(v.y) - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, hunt * 500.0 * (f(v.x) - f(v.y)), hunt * 200.0 * (f(v.y) - f(v.z))]
}

/// Colour distance for large differences (Abasi et al. 2020; 2020, equation 7).
pub fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opponent_space_is_inverted_and_white_is_neutral() {
        for rgb in [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.2, 0.9, 0.4], [0.0, 0.0, 1.0]] {
            let back = linear_of_opponent(opponent_of_linear(rgb));
            for c in 0..3 {
                assert!((back[c] - rgb[c]).abs() < 1e-5, "{rgb:?} {back:?}");
            }
        }
        let white = hunt_lab([1.0; 3]);
        assert!((white[0] - 100.0).abs() < 1e-3 && white[1].abs() < 1e-3 && white[2].abs() < 1e-3, "{white:?}");
    }
}
