//! Whether speed follows the curve (A14 in SPEC).

use super::{Course, Trace};

/// Rows before this time (s) do not count: the vehicle is still setting off.
const SETTING_OFF_S: f64 = 2.0;

/// Mean true speed (m/s) on the quarter of rows where the road is straightest, and on the quarter where it is most curved. `None` with
/// less than four rows, or on a road that is as curved everywhere.
pub(super) fn by_curvature(course: &Course, rows: &Trace, count: usize) -> Option<[f64; 2]> {
    let mut known: Vec<(f64, f64)> = (0..count)
        .filter(|row| rows.time_s[*row] - rows.time_s[0] >= SETTING_OFF_S)
        .map(|row| {
            (
                course.path.curvature_at(rows.station_m[row]).abs(),
                rows.speed_mps[row],
            )
        })
        .filter(|(curvature, speed)| curvature.is_finite() && speed.is_finite())
        .collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let quarter = known.len() / 4;
    let (straight, curved) = (&known[..quarter], &known[known.len() - quarter..]);
    if straight.last()?.0 >= curved.first()?.0 {
        return None;
    }
    let mean = |part: &[(f64, f64)]| part.iter().map(|row| row.1).sum::<f64>() / quarter as f64;
    Some([mean(straight), mean(curved)])
}
