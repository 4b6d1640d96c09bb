//! Trees for obvhs's rays, of bounded depth.

use std::collections::HashMap;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::{Boundable, BvhBuildParams};

/// Levels that obvhs's traversal can hold on its stack.
const DEEPEST: usize = 31;

/// More boxes than this that are the same box make the builder's pairs a chain.
const MOST_ALIKE: usize = 64;

/// Primitives of a leaf, the most that obvhs allows.
const LEAF: u32 = 3;

/// An eight-wide tree over boxes, whose order its `primitive_indices` give. obvhs's own builder (PLOC with reinsertion, its
/// medium preset) where its tree is shallow enough for obvhs's traversal; else, as for thousands of coincident boxes, halves
/// of equal number along the longest side.
pub fn wide_bvh(boxes: &[impl Boundable]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    if let Some(mut tree) = paired(boxes) {
        let params = BvhBuildParams::medium_build();
        ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
        let wide = bvh2_to_cwbvh(&tree, LEAF, true, false);
        if depth(&wide) <= DEEPEST {
            return wide;
        }
    }
    bvh2_to_cwbvh(&halved(boxes), LEAF, true, false)
}

/// A binary tree over boxes with at most so many levels, the root's among them: obvhs's (PLOC) where it is so shallow, else halves of
/// equal number, whose levels are the logarithm of their number.
pub fn binary_bvh(boxes: &[impl Boundable], most_levels: usize) -> Bvh2 {
    if boxes.is_empty() {
        return Bvh2::default();
    }
    paired(boxes).filter(|tree| levels(tree) <= most_levels).unwrap_or_else(|| halved(boxes))
}

/// By obvhs's own builder, which pairs neighbours; not where many boxes are the same.
fn paired(boxes: &[impl Boundable]) -> Option<Bvh2> {
    let params = BvhBuildParams::medium_build();
    (most_alike(boxes) <= MOST_ALIKE).then(|| {
        PlocBuilder::with_capacity(boxes.len()).build(
            params.ploc_search_distance,
            boxes,
            (0..boxes.len() as u32).collect(),
            params.sort_precision,
            params.search_depth_threshold,
        )
    })
}

fn levels(tree: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut waiting = vec![(0, 1)];
    while let Some((index, level)) = waiting.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[index as usize];
        if node.prim_count == 0 {
            waiting.extend([(node.first_index, level + 1), (node.first_index + 1, level + 1)]);
        }
    }
    deepest
}

/// How many boxes are one and the same, the most of any.
fn most_alike(boxes: &[impl Boundable]) -> usize {
    let mut counts: HashMap<[u32; 6], usize> = HashMap::with_capacity(boxes.len());
    for bounds in boxes {
        let bounds = bounds.aabb();
        let [a, b, c] = bounds.min.to_array().map(f32::to_bits);
        let [d, e, f] = bounds.max.to_array().map(f32::to_bits);
        *counts.entry([a, b, c, d, e, f]).or_default() += 1;
    }
    counts.into_values().max().unwrap_or(0)
}

fn depth(tree: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut waiting = vec![(0, 1)];
    while let Some((index, level)) = waiting.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[index];
        let inner = (0..8).filter(|child| !node.is_child_empty(*child) && !node.is_leaf(*child));
        waiting.extend(inner.map(|child| (node.child_node_index(child) as usize, level + 1)));
    }
    deepest
}

/// A binary tree of depth log2(n): every node's primitives halved by the order of their centres along its longest side.
fn halved(boxes: &[impl Boundable]) -> Bvh2 {
    let boxes: Vec<Aabb> = boxes.iter().map(Boundable::aabb).collect();
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default()];
    let mut waiting = vec![(0, 0..boxes.len())];
    while let Some((index, range)) = waiting.pop() {
        let part = &mut order[range.clone()];
        let bounds = part.iter().fold(Aabb::empty(), |sum, i| sum.union(&boxes[*i as usize]));
        if part.len() == 1 {
            nodes[index] = Bvh2Node::new(bounds, 1, range.start as u32);
            continue;
        }
        let extent = bounds.max - bounds.min;
        let axis = (0..3).max_by(|a, b| extent[*a].total_cmp(&extent[*b])).expect("three axes");
        let center = |i: u32| boxes[i as usize].min[axis] + boxes[i as usize].max[axis];
        let middle = part.len() / 2;
        part.select_nth_unstable_by(middle, |a, b| center(*a).total_cmp(&center(*b)).then(a.cmp(b)));
        let first = nodes.len();
        nodes[index] = Bvh2Node::new(bounds, 0, first as u32);
        nodes.extend([Bvh2Node::default(); 2]);
        waiting.push((first, range.start..range.start + middle));
        waiting.push((first + 1, range.start + middle..range.end));
    }
    Bvh2 { nodes, primitive_indices: order, children_are_ordered_after_parents: true, ..Bvh2::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};
    use glam::Vec3A;
    use obvhs::ray::Ray;

    /// Every box that a ray meets is asked for; the tree is valid by obvhs's own checks.
    fn holds(boxes: &[Aabb], tree: &CwBvh) {
        tree.validate(boxes, false);
        let mut stream = Stream::indexed(4, StreamPurpose::Test, 0);
        let mut met = 0;
        for _ in 0..200 {
            let from = (stream.direction() * 900.0).as_vec3a();
            let target = boxes[(stream.next_u64() % boxes.len() as u64) as usize].center();
            let ray = Ray::new_inf(from, target - from);
            let mut asked = vec![false; boxes.len()];
            tree.ray_traverse_anyhit(ray, |_, leaf| asked[tree.primitive_indices[leaf] as usize] = true);
            for (bounds, asked) in boxes.iter().zip(asked) {
                // the part of the box that rounding leaves in it, at coordinates up to a thousand
                let sides = [bounds.min + 0.002, bounds.max - 0.002];
                let t = sides.map(|side| (side - ray.origin) * ray.inv_direction);
                let enters = t[0].min(t[1]).max_element();
                let leaves = t[0].max(t[1]).min_element();
                if enters.max(0.0) <= leaves {
                    met += 1;
                    assert!(asked, "{bounds:?} was left out");
                }
            }
        }
        assert!(met >= 200);
    }

    fn cubes(count: usize, place: impl Fn(usize) -> (Vec3A, f32)) -> Vec<Aabb> {
        (0..count)
            .map(|i| {
                let (center, half) = place(i);
                Aabb::new(center - half, center + half)
            })
            .collect()
    }

    #[test]
    fn trees_are_shallow_and_complete() {
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 0);
        let spread: Vec<Vec3A> = (0..3000).map(|_| (stream.direction() * 400.0).as_vec3a()).collect();
        let ordinary = cubes(3000, |i| (spread[i], 3.0));
        let coincident = cubes(5000, |_| (Vec3A::splat(100.0), 1.0));
        // nested ever smaller, and in swarms that are nearly one
        let nested = cubes(2000, |i| (Vec3A::X * 0.7f32.powi(i as i32 % 250), 0.7f32.powi(i as i32 % 250).max(0.01)));
        let swarms = cubes(4000, |i| (Vec3A::splat((i % 7) as f32 * 50.0) + Vec3A::X * 1e-5 * (i as f32), 1.0));
        for boxes in [&ordinary, &coincident, &nested, &swarms, &ordinary[..1].to_vec()] {
            let tree = wide_bvh(boxes);
            assert!(depth(&tree) <= DEEPEST, "{} levels", depth(&tree));
            holds(boxes, &tree);
            // a binary one too, with no more levels than halving takes
            for most in [14, 48] {
                assert!(levels(&binary_bvh(boxes, most)) <= most, "{} levels", levels(&binary_bvh(boxes, most)));
            }
        }
        assert!(levels(&paired(&ordinary).unwrap()) > 14, "too deep for that");
        assert!(depth(&wide_bvh(&ordinary)) < 8);
        holds(&ordinary, &bvh2_to_cwbvh(&halved(&ordinary), LEAF, true, false));
        assert!(wide_bvh(&Vec::<Aabb>::new()).nodes.is_empty());
    }
}
