//! Is every variable tied to one that is held?

/// A part of a graph in which nothing is held: it could move as a whole without changing any residual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LoosePart {
    /// Its smallest vertex.
    pub first: usize,
    /// Its number of vertices.
    pub size: usize,
}

/// The loose part with the smallest first vertex, for vertices `0..held.len()` tied by pairs (all of them below it).
pub(crate) fn loose_part(held: &[bool], ties: impl Iterator<Item = (usize, usize)>) -> Option<LoosePart> {
    let part_of = representatives(held.len(), ties);
    let (mut is_held, mut size) = (vec![false; held.len()], vec![0; held.len()]);
    for (&part, held) in part_of.iter().zip(held) {
        is_held[part] |= held;
        size[part] += 1;
    }
    let first = (0..held.len()).find(|&v| size[v] > 0 && !is_held[v])?;
    Some(LoosePart { first, size: size[first] })
}

/// Per vertex: the smallest vertex that it hangs together with.
pub(crate) fn representatives(vertices: usize, ties: impl Iterator<Item = (usize, usize)>) -> Vec<usize> {
    let mut parent: Vec<usize> = (0..vertices).collect();
    for (a, b) in ties {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b)] = a.min(b);
    }
    (0..vertices).map(|vertex| root(&mut parent, vertex)).collect()
}

fn root(parent: &mut [usize], mut vertex: usize) -> usize {
    while parent[vertex] != vertex {
        parent[vertex] = parent[parent[vertex]];
        vertex = parent[vertex];
    }
    vertex
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_without_a_held_vertex_are_found() {
        let ties = [(0, 1), (4, 3), (2, 3)];
        let part = |held: [bool; 5]| loose_part(&held, ties.into_iter());
        assert_eq!(part([true, false, false, true, false]), None);
        assert_eq!(part([false, true, false, false, false]), Some(LoosePart { first: 2, size: 3 }));
        assert_eq!(part([false; 5]), Some(LoosePart { first: 0, size: 2 }));
        assert_eq!(loose_part(&[], std::iter::empty()), None);
    }
}
