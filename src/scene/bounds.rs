use glam::{DAffine3, DVec3};

/// A receiver's box: its bounding box in object space, carried by its transform. Any half extent may be 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    pub center: DVec3,
    /// Unit world directions of the object's x, y and z.
    pub axes: [DVec3; 3],
    /// Half extents along the axes, metres, not negative.
    pub half: [f64; 3],
}

impl OrientedBox {
    /// A box along the world's axes.
    pub fn aligned(min: DVec3, max: DVec3) -> Self {
        Self { center: 0.5 * (min + max), axes: [DVec3::X, DVec3::Y, DVec3::Z], half: (0.5 * (max - min)).to_array() }
    }

    /// The box under a map that keeps its edges at right angles: one that scales along the axes, turns and moves.
    /// Axes are the images of the box's own, with their sign; a mirroring map gives a left-handed frame.
    pub fn carried(&self, map: &DAffine3) -> Self {
        let edges = self.axes.map(|axis| map.transform_vector3(axis));
        Self {
            center: map.transform_point3(self.center),
            axes: edges.map(DVec3::normalize),
            half: [0, 1, 2].map(|i| self.half[i] * edges[i].length()),
        }
    }

    /// The eight corners (some alike where it lacks extent).
    pub fn corners(&self) -> [DVec3; 8] {
        let side = |bit: usize, axis: usize| if bit >> axis & 1 == 0 { -self.half[axis] } else { self.half[axis] };
        std::array::from_fn(|i| self.world([0, 1, 2].map(|axis| side(i, axis))))
    }

    /// Box coordinates of a world point: metres along the axes, from the centre.
    pub fn local(&self, world: DVec3) -> DVec3 {
        let d = world - self.center;
        DVec3::new(d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]))
    }

    /// The world point of box coordinates.
    pub fn world(&self, local: [f64; 3]) -> DVec3 {
        self.center + self.axes[0] * local[0] + self.axes[1] * local[1] + self.axes[2] * local[2]
    }

    /// Half the length of the box's diagonal.
    pub fn half_diagonal(&self) -> f64 {
        DVec3::from_array(self.half).length()
    }

    /// Distance from a world point to the box; 0 inside.
    pub fn distance(&self, world: DVec3) -> f64 {
        let q = self.local(world);
        (q.abs() - DVec3::from_array(self.half)).max(DVec3::ZERO).length()
    }
}
