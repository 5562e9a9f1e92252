//! The floor's texture, painted where cameras look: a floor is large, and most of it nobody ever sees.

use super::texture::{BORDER, FAR_BORDER, MipTexture, Packing, average, halve};
use super::view::{Outline, Squares, Stand};
use senda_core::threads::both;
use senda_world::FloorPainting;
use senda_world::paint::{Brush, Painter, Window};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{RwLock, RwLockReadGuard};

/// Level in which a tile is one texel.
const TILE_LEVEL: usize = 7;

/// Side of a tile, which is painted as a whole (texels of level 0).
const TILE: usize = 1 << TILE_LEVEL;

/// What is only seen from far is kept from this level up: finer ones would take sixteen times the memory.
const FAR_LEVEL: usize = 2;

/// Tiles that one thread paints before they are stored.
const BATCH: usize = 8;

/// Nothing of a tile is ready.
const NOTHING: u8 = u8::MAX;

/// How much further than a camera looks the floor is painted: this often less is asked whether it is (texels; angle in rad).
const AROUND: (f64, f64) = (24.0, 0.05);

/// The number of the next ground.
static NEXT: AtomicU64 = AtomicU64::new(0);

/// From where everything that a camera sees of a ground is known to be painted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Painted {
    ground: u64,
    from: Stand,
}

/// The floor's texture. Looks see the same texels whoever looked first, and however many look at once.
#[derive(Debug)]
pub(super) struct Ground {
    /// Tells it from all others.
    number: u64,
    levels: usize,
    floor: RwLock<Floor>,
}

#[derive(Debug)]
pub(super) struct Floor {
    texture: MipTexture,
    /// `None`: everything is there.
    rest: Option<Rest>,
}

/// What is there, and what is needed to paint the rest.
#[derive(Debug)]
struct Rest {
    painter: Painter,
    squares: Squares,
    /// Finest level that is ready, tile by tile, with those of the border around them.
    ready: Vec<u8>,
    /// Which texels are ready in the levels whose texels are larger than tiles, finest first.
    coarse: Vec<Coarse>,
    /// Packed; known once somebody looked beyond the edge.
    outside: Option<u32>,
    pack: Packing,
    /// Tiles to be painted.
    jobs: Vec<Job>,
    /// Two threads paint.
    hands: [Hand; 2],
    border: Vec<u32>,
}

/// A tile, counted with the border's, that shall be ready from a level on.
#[derive(Debug, Clone, Copy)]
struct Job {
    tile: [usize; 2],
    finest: u8,
}

/// Somebody who paints, with what is painted and not stored yet.
#[derive(Debug, Default)]
struct Hand {
    brush: Brush,
    texels: Vec<[u8; 4]>,
    tiles: [Pyramid; BATCH],
}

/// The levels of a tile.
#[derive(Debug, Default)]
struct Pyramid {
    levels: [Vec<u32>; TILE_LEVEL + 1],
}

#[derive(Debug)]
struct Coarse {
    squares: Squares,
    ready: Vec<bool>,
}

impl Ground {
    /// Nothing is painted yet.
    pub(super) fn new(painter: Painter) -> Self {
        let (width, height) = painter.size();
        let texture = MipTexture::blank(width, height);
        let squares = |level: usize| Squares {
            side: 1 << level,
            size: [width, height],
        };
        let count = |squares: &Squares| squares.count()[0] * squares.count()[1];
        let tiles = squares(TILE_LEVEL);
        let coarse = |level: usize| Coarse {
            squares: squares(level),
            ready: vec![false; count(&squares(level))],
        };
        Self {
            number: NEXT.fetch_add(1, Ordering::Relaxed),
            levels: texture.levels(),
            floor: RwLock::new(Floor {
                rest: Some(Rest {
                    painter,
                    squares: tiles,
                    ready: vec![NOTHING; count(&tiles)],
                    coarse: (TILE_LEVEL + 1..texture.levels()).map(coarse).collect(),
                    outside: None,
                    pack: Packing::new(),
                    jobs: Vec::with_capacity(count(&tiles)),
                    hands: Default::default(),
                    border: Vec::new(),
                }),
                texture,
            }),
        }
    }

    /// From a finished painting.
    pub(super) fn of_painting(painting: &FloorPainting) -> Self {
        let texture = MipTexture::new(
            painting.width,
            painting.height,
            &painting.texels,
            painting.outside,
        );
        Self {
            number: NEXT.fetch_add(1, Ordering::Relaxed),
            levels: texture.levels(),
            floor: RwLock::new(Floor { texture, rest: None }),
        }
    }

    /// Number of levels.
    pub(super) fn levels(&self) -> usize {
        self.levels
    }

    /// The texture, with everything painted that lies within the outlines of a camera that stands somewhere. `painted` is what is
    /// known of the camera's last look.
    pub(super) fn seen(
        &self,
        outlines: &[Outline],
        stand: &Stand,
        painted: &mut Option<Painted>,
        spans: &mut Vec<[f64; 2]>,
    ) -> RwLockReadGuard<'_, Floor> {
        if painted.is_some_and(|known| known.ground == self.number && known.from.covers(stand)) {
            return self.read();
        }
        let from = stand.widened(AROUND.0, AROUND.1);
        *painted = Some(Painted {
            ground: self.number,
            from,
        });
        let floor = self.read();
        if !floor.lacks(outlines, &from, spans) {
            return floor;
        }
        drop(floor);
        let mut floor = self.floor.write().expect(PAINTED);
        floor.complete(outlines, &from, spans);
        drop(floor);
        // Nothing is ever taken away again.
        self.read()
    }

    fn read(&self) -> RwLockReadGuard<'_, Floor> {
        self.floor.read().expect(PAINTED)
    }
}

/// Half a tile must not be shown as if it were a whole one.
const PAINTED: &str = "nobody who painted this floor panicked";

impl Floor {
    pub(super) fn texture(&self) -> &MipTexture {
        &self.texture
    }

    /// Whether anything within the outlines is not ready.
    fn lacks(&self, outlines: &[Outline], stand: &Stand, spans: &mut Vec<[f64; 2]>) -> bool {
        let Some(rest) = &self.rest else { return false };
        outlines.iter().any(|outline| {
            if let Some(coarse) = outline.level.checked_sub(TILE_LEVEL + 1) {
                let Coarse { squares, ready } = &rest.coarse[coarse];
                let columns_all = squares.count()[0];
                outline.any_touched(stand, squares, spans, |row, columns| {
                    ready[row * columns_all..][columns].contains(&false)
                })
            } else {
                let columns_all = rest.squares.count()[0];
                outline.any_touched(stand, &rest.squares, spans, |row, columns| {
                    let tiles = &rest.ready[row * columns_all..][columns];
                    tiles.iter().any(|finest| usize::from(*finest) > outline.level)
                })
            }
        })
    }

    /// Makes ready what lies within the outlines.
    fn complete(&mut self, outlines: &[Outline], stand: &Stand, spans: &mut Vec<[f64; 2]>) {
        let Self {
            texture,
            rest: Some(rest),
        } = self
        else {
            return;
        };
        for outline in outlines {
            rest.list_jobs(outline, stand, spans);
        }
        rest.do_jobs(texture);
        for outline in outlines {
            let Some(coarse) = outline.level.checked_sub(TILE_LEVEL + 1) else {
                continue;
            };
            let squares = rest.coarse[coarse].squares;
            outline.any_touched(stand, &squares, spans, |row, columns| {
                for column in columns {
                    rest.complete_coarse(texture, coarse, [column, row]);
                }
                false
            });
        }
    }
}

impl Rest {
    /// Lists the tiles that an outline needs and that are not ready.
    fn list_jobs(&mut self, outline: &Outline, stand: &Stand, spans: &mut Vec<[f64; 2]>) {
        let Self {
            squares: tiles,
            ready,
            coarse,
            jobs,
            ..
        } = self;
        let [columns_all, rows_all] = tiles.count();
        let mut list = |tile: [usize; 2], level: usize| {
            let finest = &mut ready[tile[1] * columns_all + tile[0]];
            if usize::from(*finest) > level {
                // Those at the border hold one colour: there is nothing to be saved.
                let inside = (1..columns_all - 1).contains(&tile[0]) && (1..rows_all - 1).contains(&tile[1]);
                *finest = if inside && level >= FAR_LEVEL {
                    level as u8
                } else {
                    0
                };
                jobs.push(Job {
                    tile,
                    finest: *finest,
                });
            }
        };
        let Some(number) = outline.level.checked_sub(TILE_LEVEL + 1) else {
            outline.any_touched(stand, tiles, spans, |row, columns| {
                columns.for_each(|column| list([column, row], outline.level));
                false
            });
            return;
        };
        // All tiles that a larger texel is the mean of; the border of coarse levels is not made of tiles.
        let Coarse { squares, ready } = &coarse[number];
        let [wide, _] = squares.count();
        let many = 1 << (outline.level - TILE_LEVEL);
        let span = |square: usize, most: usize| {
            let first = square.saturating_sub(1) * many + 1;
            if square == 0 {
                0..0
            } else {
                first..(first + many).min(most - 1)
            }
        };
        outline.any_touched(stand, squares, spans, |row, columns| {
            for column in columns.filter(|column| !ready[row * wide + column]) {
                for tile_row in span(row, rows_all) {
                    span(column, columns_all).for_each(|tile| list([tile, tile_row], TILE_LEVEL));
                }
            }
            false
        });
    }

    /// Paints and stores the tiles that were listed.
    fn do_jobs(&mut self, texture: &mut MipTexture) {
        let jobs = std::mem::take(&mut self.jobs);
        let [columns, rows] = self.squares.count();
        let inner =
            |job: &Job| (1..columns - 1).contains(&job.tile[0]) && (1..rows - 1).contains(&job.tile[1]);
        // Whether anything but whole tiles is concerned: only then must the colour of the outside be known.
        let (width, height) = texture.size(0);
        let whole = |job: &Job| inner(job) && job.tile[0] * TILE <= width && job.tile[1] * TILE <= height;
        let outside = if jobs.iter().all(whole) { 0 } else { self.outside() };
        for job in jobs.iter().filter(|job| !inner(job)) {
            self.store_border(texture, job.tile, outside);
        }
        let Self {
            painter, pack, hands, ..
        } = self;
        let mut inner = jobs.iter().copied().filter(inner);
        loop {
            let mut taken = [None; 2 * BATCH];
            for (slot, job) in taken.iter_mut().zip(inner.by_ref()) {
                *slot = Some(job);
            }
            let count = taken.iter().flatten().count();
            if count == 0 {
                break;
            }
            let (first, second) = taken[..count].split_at(count.div_ceil(2));
            let [left, right] = hands;
            let paint = |hand: &mut Hand, jobs: &[Option<Job>]| {
                for (number, job) in jobs.iter().flatten().enumerate() {
                    hand.paint(painter, pack, outside, job, number);
                }
            };
            both(
                count * TILE * TILE,
                || paint(left, first),
                || paint(right, second),
            );
            for (hand, jobs) in [(&*left, first), (&*right, second)] {
                for (tile, job) in hand.tiles.iter().zip(jobs.iter().flatten()) {
                    tile.store(job, texture);
                }
            }
        }
        drop(inner);
        self.jobs = jobs;
        self.jobs.clear();
    }

    /// Stores a tile's part of the border in all levels that consist of tiles.
    fn store_border(&mut self, texture: &mut MipTexture, tile: [usize; 2], outside: u32) {
        let counts = self.squares.count();
        for level in 0..texture.levels().min(TILE_LEVEL + 1) {
            let size = <[usize; 2]>::from(texture.size(level));
            let side = TILE >> level;
            let [columns, rows] = [0, 1].map(|axis| match tile[axis] {
                0 => 0..BORDER,
                last if last + 1 == counts[axis] => BORDER + size[axis]..BORDER + size[axis] + FAR_BORDER,
                number => BORDER + (number - 1) * side..BORDER + (number * side).min(size[axis]),
            });
            self.border.clear();
            self.border.resize(columns.len() * rows.len(), outside);
            texture.store(level, [columns.start, rows.start], columns.len(), &self.border);
        }
    }

    /// Makes a texel of a coarse level ready, whose tiles are.
    fn complete_coarse(&mut self, texture: &mut MipTexture, coarse: usize, [column, row]: [usize; 2]) {
        let Coarse { squares, ready } = &mut self.coarse[coarse];
        let [columns, rows] = squares.count();
        if std::mem::replace(&mut ready[row * columns + column], true) {
            return;
        }
        let level = TILE_LEVEL + 1 + coarse;
        if column == 0 || row == 0 || column + 1 == columns || row + 1 == rows {
            let outside = self.outside();
            texture.surround(level, outside);
            return;
        }
        let (width, height) = texture.size(level - 1);
        let mut parts = [0; 4];
        for (i, part) in parts.iter_mut().enumerate() {
            let (x, y) = (2 * (column - 1) + i % 2, 2 * (row - 1) + i / 2);
            if x >= width || y >= height {
                *part = self.outside();
                continue;
            }
            if let Some(finer) = coarse.checked_sub(1) {
                self.complete_coarse(texture, finer, [x + 1, y + 1]);
            }
            *part = texture.texel(level - 1, x, y);
        }
        let [a, b, c, d] = parts;
        let at = [BORDER + column - 1, BORDER + row - 1];
        texture.store(level, at, 1, &[average(a, b, c, d)]);
    }

    /// What lies beyond the edge, packed.
    fn outside(&mut self) -> u32 {
        let (pack, painter) = (&self.pack, &self.painter);
        *self.outside.get_or_insert_with(|| pack.texel(painter.outside()))
    }
}

impl Hand {
    /// Paints a tile on the texture with all its levels.
    fn paint(&mut self, painter: &Painter, pack: &Packing, outside: u32, job: &Job, number: usize) {
        let (width, height) = painter.size();
        let side = |number: usize, size: usize| (number - 1) * TILE..(number * TILE).min(size);
        let window = Window {
            columns: side(job.tile[0], width),
            rows: side(job.tile[1], height),
        };
        let (mut wide, mut high) = (window.columns.len(), window.rows.len());
        // Every texel is painted: what is there from another tile does not matter.
        self.texels.resize(wide * high, [0; 4]);
        painter.paint(&window, &mut self.brush, &mut self.texels);
        let levels = &mut self.tiles[number].levels;
        pack.texels(&self.texels, &mut levels[0]);
        for level in 0..TILE_LEVEL {
            let [finer, coarser] = &mut levels[level..level + 2] else {
                return;
            };
            halve(finer, (wide, high), outside, coarser);
            (wide, high) = (wide.div_ceil(2), high.div_ceil(2));
        }
    }
}

impl Pyramid {
    /// Stores the levels that the job asks for.
    fn store(&self, job: &Job, texture: &mut MipTexture) {
        let levels = texture.levels().min(TILE_LEVEL + 1);
        let width = texture.size(0).0;
        let side = (job.tile[0] * TILE).min(width) - (job.tile[0] - 1) * TILE;
        for (level, texels) in self
            .levels
            .iter()
            .enumerate()
            .take(levels)
            .skip(usize::from(job.finest))
        {
            let at = job.tile.map(|number| BORDER + (number - 1) * (TILE >> level));
            texture.store(level, at, side.div_ceil(1 << level), texels);
        }
    }
}
