//! Morphology of masks (bytes 0 and not 0) with a square of 3x3, repeated for larger ones.

/// Sets every pixel that has a set neighbour (8 neighbours) `times` times over; `scratch` is as large as the mask.
///
/// # Panics
/// When the lengths differ or are not whole rows.
pub fn dilate(mask: &mut [u8], scratch: &mut [u8], width: usize, times: usize) {
    spread(mask, scratch, width, times, u8::max);
}

/// Clears every pixel that has a cleared neighbour (8 neighbours) `times` times over. Outside the picture counts as
/// set.
///
/// # Panics
/// As [`dilate`].
pub fn erode(mask: &mut [u8], scratch: &mut [u8], width: usize, times: usize) {
    spread(mask, scratch, width, times, u8::min);
}

fn spread(mask: &mut [u8], scratch: &mut [u8], width: usize, times: usize, extreme: impl Fn(u8, u8) -> u8) {
    assert_eq!(mask.len(), scratch.len());
    if mask.is_empty() {
        return;
    }
    assert!(
        width > 0 && mask.len().is_multiple_of(width),
        "expected whole rows"
    );
    let last = mask.len() / width - 1;
    for _ in 0..times {
        for (to, from) in scratch.chunks_exact_mut(width).zip(mask.chunks_exact(width)) {
            to.copy_from_slice(from);
            for x in 1..width {
                to[x] = extreme(to[x], from[x - 1]);
                to[x - 1] = extreme(to[x - 1], from[x]);
            }
        }
        for (y, to) in mask.chunks_exact_mut(width).enumerate() {
            let row = |y: usize| &scratch[y * width..(y + 1) * width];
            let (above, own, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(last)));
            for x in 0..width {
                to[x] = extreme(extreme(above[x], own[x]), below[x]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_step_is_the_extreme_of_the_neighbours(
            (width, mask) in (1usize..20).prop_flat_map(|width| {
                (1usize..12).prop_flat_map(move |height| {
                    prop::collection::vec(prop::sample::select(vec![0u8, 255]), width * height)
                        .prop_map(move |mask| (width, mask))
                })
            }),
        ) {
            let height = mask.len() / width;
            let neighbours = |i: usize| {
                let (x, y) = (i % width, i / width);
                let (xs, ys) = (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
                ys.flat_map(move |y| xs.clone().map(move |x| y * width + x))
            };
            let mut scratch = vec![0; mask.len()];
            let (mut grown, mut shrunk) = (mask.clone(), mask.clone());
            dilate(&mut grown, &mut scratch, width, 1);
            erode(&mut shrunk, &mut scratch, width, 1);
            for i in 0..mask.len() {
                prop_assert_eq!(grown[i], neighbours(i).map(|j| mask[j]).max().unwrap());
                prop_assert_eq!(shrunk[i], neighbours(i).map(|j| mask[j]).min().unwrap());
            }
        }
    }

    #[test]
    fn empty_masks_stay_empty() {
        dilate(&mut [], &mut [], 0, 3);
    }
}
