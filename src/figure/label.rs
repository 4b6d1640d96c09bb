//! Names beside points, so that none lies on another, on a point, or outside: a small search over places around each point.

use super::drawing::{Anchor, CAP, Colour, Drawing, Rect, Stroke, text_width};
use super::style::GREY;

/// A name to place.
#[derive(Clone, Debug)]
pub struct Label {
    pub point: [f64; 2],
    pub text: String,
    pub size: f64,
    pub colour: Colour,
    /// Labels of a lower rank are placed first, and are dropped last.
    pub rank: usize,
    /// The cost above which it is left out; a name that matters has [`ANY`] patience.
    pub patience: f64,
}

/// What labels keep away from.
#[derive(Clone, Debug, Default)]
pub struct Obstacles {
    /// Centres and radii of markers: never covered.
    pub markers: Vec<([f64; 2], f64)>,
    /// Lines: avoided.
    pub lines: Vec<[[f64; 2]; 2]>,
    /// Boxes: never covered.
    pub boxes: Vec<Rect>,
}

/// A placed label.
#[derive(Clone, Debug)]
pub struct Placed {
    pub label: usize,
    pub rect: Rect,
    /// From the marker's edge to the text, where they are apart.
    pub leader: Option<[[f64; 2]; 2]>,
}

/// Distances from a point to its name's box, pixels, and directions in 24ths of a turn.
const DISTANCES: [f64; 10] = [7.0, 11.0, 16.0, 23.0, 31.0, 41.0, 53.0, 67.0, 84.0, 104.0];
const DIRECTIONS: usize = 24;
/// From here on a line leads from the point to its name.
const LEADER_FROM: f64 = 12.0;
/// Air around a name.
const AIR: f64 = 2.0;
/// A cost that means: not acceptable.
const BLOCKED: f64 = 1e6;
/// The patience of a label that stands wherever it can without lying on something.
pub const ANY: f64 = BLOCKED;
/// The patience of a label that is left out rather than far away or on a line.
pub const LITTLE: f64 = 33.0;

/// Places labels within `bounds`; a label that finds no free place is left out.
pub fn place(labels: &[Label], obstacles: &Obstacles, bounds: &Rect) -> Vec<Placed> {
    let candidates: Vec<Vec<(Placed, f64)>> =
        labels.iter().enumerate().map(|(i, l)| candidates(i, l, obstacles, bounds)).collect();
    // of one rank, those that have a good place come first
    let best = |i: usize| candidates[i].iter().map(|c| c.1).fold(f64::MAX, f64::min);
    let mut order: Vec<usize> = (0..labels.len()).collect();
    order.sort_by(|a, b| labels[*a].rank.cmp(&labels[*b].rank).then(best(*a).total_cmp(&best(*b))));
    let mut chosen: Vec<Option<Placed>> = vec![None; labels.len()];
    // later rounds move a label once all others have theirs
    for _round in 0..4 {
        for &i in &order {
            chosen[i] = None;
            let best = candidates[i]
                .iter()
                .map(|(candidate, cost)| (candidate, cost + conflicts(candidate, &chosen)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            chosen[i] = best.filter(|(_, cost)| *cost < labels[i].patience).map(|(candidate, _)| candidate.clone());
        }
    }
    chosen.into_iter().flatten().collect()
}

/// Draws placed labels with their leaders.
pub fn draw(drawing: &mut Drawing, labels: &[Label], placed: &[Placed]) {
    for p in placed {
        if let Some(leader) = p.leader {
            drawing.line(leader, Stroke::new(GREY, 0.75));
        }
    }
    for p in placed {
        let label = &labels[p.label];
        let baseline = [p.rect.x + AIR, p.rect.y + AIR + CAP * label.size];
        drawing.text(baseline, &label.text, label.size, label.colour, Anchor::Start);
    }
}

fn candidates(index: usize, label: &Label, obstacles: &Obstacles, bounds: &Rect) -> Vec<(Placed, f64)> {
    let (width, height) = (text_width(&label.text, label.size) + 2.0 * AIR, (CAP + 0.22) * label.size + 2.0 * AIR);
    let [x, y] = label.point;
    let mut found = Vec::new();
    for distance in DISTANCES {
        for direction in 0..DIRECTIONS {
            let (sin, cos) = (std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64).sin_cos();
            // the box touches the ring: its centre is pushed out by its extent in that direction
            let rect = Rect::new(
                x + cos * distance + 0.5 * (cos.signum() * cos.abs().sqrt() - 1.0) * width,
                y - sin * distance + 0.5 * (-sin.signum() * sin.abs().sqrt() - 1.0) * height,
                width,
                height,
            );
            if rect.x < bounds.x
                || rect.right() > bounds.right()
                || rect.y < bounds.y
                || rect.bottom() > bounds.bottom()
            {
                continue;
            }
            let touch = rect.grown(-AIR).nearest(label.point);
            let gap = (touch[0] - x).hypot(touch[1] - y);
            let leader = (gap >= LEADER_FROM).then(|| {
                let start = 5.0 / gap;
                [[x + start * (touch[0] - x), y + start * (touch[1] - y)], touch]
            });
            // near before far, right before left, below before above: a front leaves its lower side empty
            let mut cost = 0.45 * distance + if leader.is_some() { 5.0 } else { 0.0 } + 1.2 * (1.0 - cos) + 0.3 * sin;
            // a name that is nearer to another point would be taken for that one's
            let gap_to = |p: [f64; 2]| {
                let nearest = rect.nearest(p);
                (nearest[0] - p[0]).hypot(nearest[1] - p[1])
            };
            let others = obstacles.markers.iter().filter(|(m, _)| *m != label.point);
            cost += 9.0 * others.filter(|(m, _)| gap_to(*m) < gap_to(label.point) + 4.0).count() as f64;
            cost += obstacle_cost(&rect, leader, label.point, obstacles);
            if cost < BLOCKED {
                found.push((Placed { label: index, rect, leader }, cost));
            }
        }
    }
    found
}

fn obstacle_cost(rect: &Rect, leader: Option<[[f64; 2]; 2]>, own: [f64; 2], obstacles: &Obstacles) -> f64 {
    let mut cost = 0.0;
    for (center, radius) in &obstacles.markers {
        let nearest = rect.nearest(*center);
        if (nearest[0] - center[0]).hypot(nearest[1] - center[1]) < radius + 1.0 {
            cost += BLOCKED;
        }
        if let Some(line) = leader
            && *center != own
            && distance_to_segment(*center, line) < radius + 1.0
        {
            cost += 60.0;
        }
    }
    for line in &obstacles.lines {
        cost += 25.0 * f64::from(u8::from(crosses(rect, *line)));
        if leader.is_some_and(|l| segments_cross(l, *line)) {
            cost += 3.0;
        }
    }
    for other in &obstacles.boxes {
        if rect.overlap(other) > 0.0 {
            cost += BLOCKED;
        }
    }
    cost
}

fn conflicts(candidate: &Placed, chosen: &[Option<Placed>]) -> f64 {
    let mut cost = 0.0;
    for other in chosen.iter().flatten() {
        if candidate.rect.overlap(&other.rect) > 0.0 {
            cost += BLOCKED;
        }
        if let Some(line) = candidate.leader
            && crosses(&other.rect, line)
        {
            cost += BLOCKED;
        }
        if let Some(line) = other.leader {
            if crosses(&candidate.rect, line) {
                cost += BLOCKED;
            }
            if candidate.leader.is_some_and(|own| segments_cross(own, line)) {
                cost += 80.0;
            }
        }
    }
    cost
}

fn distance_to_segment(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1]];
    let squared = d[0] * d[0] + d[1] * d[1];
    let t = if squared > 0.0 { (((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (p[0] - a[0] - t * d[0]).hypot(p[1] - a[1] - t * d[1])
}

fn segments_cross([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let side = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

fn crosses(rect: &Rect, line: [[f64; 2]; 2]) -> bool {
    let corners = rect.corners();
    rect.contains(line[0])
        || rect.contains(line[1])
        || (0..4).any(|i| segments_cross(line, [corners[i], corners[(i + 1) % 4]]))
}

#[cfg(test)]
mod tests {
    use super::super::style::INK;
    use super::*;

    fn labels(points: &[[f64; 2]]) -> Vec<Label> {
        let text = |i: usize| format!("lattice {i}x2x2");
        (0..points.len())
            .map(|i| Label { point: points[i], text: text(i), size: 12.0, colour: INK, rank: i, patience: ANY })
            .collect()
    }

    /// Pairs of texts that lie on each other, and texts that lie on markers.
    fn overlaps(placed: &[Placed], markers: &[([f64; 2], f64)]) -> usize {
        let pairs = placed.iter().enumerate().flat_map(|(i, a)| placed[..i].iter().map(move |b| (a, b)));
        pairs.filter(|(a, b)| a.rect.overlap(&b.rect) > 0.0).count()
            + placed.iter().filter(|p| markers.iter().any(|(m, _)| p.rect.contains(*m))).count()
    }

    #[test]
    fn crowded_labels_do_not_overlap() {
        let bounds = Rect::new(0.0, 0.0, 420.0, 300.0);
        // a tight cluster, a row, and one in the corner
        let mut points: Vec<[f64; 2]> = (0..8).map(|i| [200.0 + 4.0 * i as f64, 150.0 - 6.0 * i as f64]).collect();
        points.extend((0..5).map(|i| [40.0 + 60.0 * i as f64, 260.0]));
        points.push([418.0, 2.0]);
        let markers: Vec<_> = points.iter().map(|p| (*p, 5.0)).collect();
        let labels = labels(&points);
        let obstacles = Obstacles { markers: markers.clone(), ..Obstacles::default() };
        let placed = place(&labels, &obstacles, &bounds);
        assert_eq!(placed.len(), labels.len(), "all have room");
        assert_eq!(overlaps(&placed, &markers), 0);
        assert!(placed.iter().any(|p| p.leader.is_some()));
        assert!(placed.iter().all(|p| p.rect.x >= 0.0 && p.rect.right() <= 420.0));
        // beside their points without a search they do lie on each other
        let naive: Vec<Placed> = (0..points.len())
            .map(|i| Placed {
                label: i,
                rect: Rect::new(points[i][0] + 7.0, points[i][1] - 6.0, 80.0, 12.0),
                leader: None,
            })
            .collect();
        assert!(overlaps(&naive, &markers) > 0);
    }

    #[test]
    fn without_room_the_last_ranks_are_left_out() {
        let bounds = Rect::new(0.0, 0.0, 200.0, 70.0);
        let points: Vec<[f64; 2]> = (0..12).map(|i| [10.0 + 16.0 * i as f64, 35.0]).collect();
        let labels = labels(&points);
        let markers = points.iter().map(|p| (*p, 3.0)).collect();
        let placed = place(&labels, &Obstacles { markers, ..Obstacles::default() }, &bounds);
        assert!(!placed.is_empty() && placed.len() < labels.len());
        assert!(placed.iter().any(|p| p.label == 0), "rank 0 is served first");
    }
}
