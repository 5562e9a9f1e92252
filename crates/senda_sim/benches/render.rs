//! Frames and steps a second: `cargo bench -p senda_sim`.

use criterion::{Criterion, criterion_group, criterion_main};

fn all(criterion: &mut Criterion) {
    for mut case in senda_sim::bench::cases().expect("the bench's options are valid") {
        criterion.bench_function(case.name, |bencher| bencher.iter(|| (case.call)()));
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
