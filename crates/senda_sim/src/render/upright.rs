//! Upright textured things and trees: faces drawn over the floor, the farthest first.

use super::Shot;
use super::kernel::{COLOUR_SCALE, Colours, GROUP};
use super::rays::RayTable;
use super::texture::MipTexture;
use super::tree;
use senda_geom::{Camera, Pose2, Vec2, Vec3};
use senda_world::{Face, Light, LightProgram, Texture, Tree};
use std::sync::OnceLock;

/// A face with its picture, lit.
#[derive(Debug, Clone)]
pub(super) struct Upright {
    corner: Vec3,
    right: Vec3,
    down: Vec3,
    normal: Vec3,
    width_m: f64,
    height_m: f64,
    picture: Picture,
    /// Drawn when a camera first sees it: one look, or those between which it changes.
    looks: OnceLock<Vec<MipTexture>>,
    /// When it changes.
    program: Option<LightProgram>,
    /// Texels a metre, along right and down.
    texels_per_m: [f64; 2],
    /// Where a tree stands (world, m): it turns towards the camera, and one sees through between its leaves.
    tree: Option<Vec2>,
}

/// What is on a face, and how bright white is there (encoded, R, G, B).
#[derive(Debug, Clone)]
enum Picture {
    /// A texture in so many columns and rows of texels.
    Painted(Texture, [usize; 2], [f64; 3]),
    Tree(Tree, [f64; 3]),
}

/// Texels along a thing's longer side, at most: signs and codes are read from near.
pub(super) const MOST_TEXELS: f64 = 512.0;
/// Texels along a wall's block: plain stone.
pub(super) const WALL_TEXELS: f64 = 64.0;
/// Finest texel (m).
const FINEST_M: f64 = 0.001;

impl Upright {
    /// A face with at most so many texels along its longer side.
    pub(super) fn new(face: &Face, most_texels: f64, light: &Light) -> Self {
        let longest_m = face.width_m.max(face.height_m);
        let texel_m = (longest_m / most_texels).max(FINEST_M);
        let count = |side_m: f64| ((side_m / texel_m).round() as usize).clamp(1, most_texels as usize);
        let (columns, rows) = (count(face.width_m), count(face.height_m));
        let (step_x, step_y) = (face.width_m / columns as f64, face.height_m / rows as f64);
        let level = if face.texture.shines() {
            [1.0; 3]
        } else {
            brightness(face.normal, light)
        };
        Self {
            corner: face.corner,
            right: face.right,
            down: face.down,
            normal: face.normal,
            width_m: face.width_m,
            height_m: face.height_m,
            program: match face.texture {
                Texture::Light { program, .. } => Some(program),
                _ => None,
            },
            texels_per_m: [1.0 / step_x, 1.0 / step_y],
            tree: None,
            picture: Picture::Painted(face.texture.clone(), [columns, rows], level),
            looks: OnceLock::new(),
        }
    }

    /// A tree; its place in the scene is worked out frame by frame.
    pub(super) fn of_tree(tree: &Tree, light: &Light) -> Self {
        Self {
            corner: Vec3::ZERO,
            right: Vec3::X,
            down: Vec3::NEG_Z,
            normal: Vec3::Y,
            width_m: tree.width_m,
            height_m: tree.height_m,
            program: None,
            texels_per_m: [
                tree::COLUMNS as f64 / tree.width_m,
                tree::ROWS as f64 / tree.height_m,
            ],
            tree: Some(tree.position),
            picture: Picture::Tree(*tree, brightness(Vec3::new(0.0, 0.0, 0.6), light)),
            looks: OnceLock::new(),
        }
    }

    fn looks(&self) -> &[MipTexture] {
        self.looks.get_or_init(|| match &self.picture {
            Picture::Painted(texture, size, level) => {
                let looks = texture.looks();
                looks
                    .iter()
                    .map(|look| self.painted(look, *size, *level))
                    .collect()
            }
            Picture::Tree(tree, level) => {
                let texels = tree::picture(tree, *level);
                vec![MipTexture::new(tree::COLUMNS, tree::ROWS, &texels, texels[0])]
            }
        })
    }

    fn painted(&self, texture: &Texture, [columns, rows]: [usize; 2], level: [f64; 3]) -> MipTexture {
        let (step_x, step_y) = (self.width_m / columns as f64, self.height_m / rows as f64);
        let mut texels = Vec::with_capacity(columns * rows);
        for j in 0..rows {
            for i in 0..columns {
                let mut sum = [0.0; 3];
                for (du, dv) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                    let colour = texture.colour_at(
                        (i as f64 + du) * step_x,
                        (j as f64 + dv) * step_y,
                        self.width_m,
                        self.height_m,
                    );
                    sum = [0, 1, 2].map(|c| sum[c] + f64::from(colour.rgb[c]) * 0.25);
                }
                let lit = |c: usize| (sum[c] * level[c]).round().clamp(0.0, 255.0) as u8;
                texels.push([lit(0), lit(1), lit(2), 0]);
            }
        }
        // Blended at its edges, so what lies outside must not be seen: repeat a colour of its own.
        let outside = texels[0];
        MipTexture::new(columns, rows, &texels, outside)
    }
}

/// Encoded brightness of a face: ambient light from above and, on the lit side, from the light's direction.
fn brightness(normal: Vec3, light: &Light) -> [f64; 3] {
    let (sin, cos) = senda_geom::trig::sincos(light.elevation_rad);
    let (sin_a, cos_a) = senda_geom::trig::sincos(light.direction_rad);
    let facing = normal.dot(Vec3::new(cos * cos_a, cos * sin_a, sin)).max(0.0);
    let level = (0.5 + 0.2 * normal.z + 0.35 * facing).min(1.0);
    light
        .colour
        .rgb
        .map(|value| f64::from(value) / 255.0 * level.sqrt())
}

/// A face ready for one frame, in the vehicle frame relative to the camera.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ready {
    index: usize,
    /// Which of its looks.
    look: usize,
    distance_m: f64,
    normal: [f32; 3],
    /// normal · (corner - camera): negative in front of the face.
    offset: f32,
    right: [f32; 3],
    down: [f32; 3],
    right_offset: f32,
    down_offset: f32,
    first_row: usize,
    end_row: usize,
    first_column: usize,
    end_column: usize,
}

/// Finds the faces that a camera sees and sorts them, the farthest first.
pub(super) fn prepare(
    faces: &[Upright],
    camera: &Camera,
    shot: &Shot,
    table: &RayTable,
    ready: &mut Vec<Ready>,
) {
    ready.clear();
    if faces.is_empty() {
        return;
    }
    let lens_in_vehicle = camera.mounting.position();
    let axis = camera.mounting.vehicle_from_camera().col(2);
    let vehicle_from_world = shot.world_from_vehicle.inverse();
    let turn = Pose2::new(0.0, 0.0, vehicle_from_world.heading_rad);
    for (index, face) in faces.iter().enumerate() {
        let point = |p: Vec3| {
            let flat = vehicle_from_world.transform(Vec2::new(p.x, p.y));
            Vec3::new(flat.x, flat.y, p.z)
        };
        let direction = |d: Vec3| {
            let flat = turn.transform(Vec2::new(d.x, d.y));
            Vec3::new(flat.x, flat.y, d.z)
        };
        let (corner, normal, right, down) = match face.tree {
            None => (
                point(face.corner) - lens_in_vehicle,
                direction(face.normal),
                direction(face.right),
                direction(face.down),
            ),
            Some(place) => {
                let foot = vehicle_from_world.transform(place);
                let towards = Vec2::new(lens_in_vehicle.x, lens_in_vehicle.y) - foot;
                let away_m = towards.length();
                // A tree smaller than half a pixel, or one that the camera stands in, is not drawn.
                if away_m < 0.5 * face.width_m || face.height_m < 0.5 * table.pitch_rad * away_m {
                    continue;
                }
                let normal = towards / away_m;
                let right = normal.perp();
                let corner = foot - right * (0.5 * face.width_m);
                (
                    Vec3::new(corner.x, corner.y, face.height_m) - lens_in_vehicle,
                    Vec3::new(normal.x, normal.y, 0.0),
                    Vec3::new(right.x, right.y, 0.0),
                    Vec3::NEG_Z,
                )
            }
        };
        let middle = corner + right * (0.5 * face.width_m) + down * (0.5 * face.height_m);
        if middle.dot(axis) < -0.5 * (face.width_m + face.height_m) {
            continue; // All of it is behind the lens.
        }
        let offset = normal.dot(corner);
        if offset > -1e-4 {
            continue; // Seen from behind or along the edge.
        }
        let Some([first_column, end_column, first_row, end_row]) =
            bounds(face, corner + lens_in_vehicle, right, down, camera, table)
        else {
            continue;
        };
        let single = |v: Vec3| [v.x as f32, v.y as f32, v.z as f32];
        ready.push(Ready {
            index,
            look: face
                .program
                .map_or(0, |program| usize::from(program.is_green(shot.time_s))),
            distance_m: middle.length(),
            normal: single(normal),
            offset: offset as f32,
            right: single(right),
            down: single(down),
            right_offset: right.dot(corner) as f32,
            down_offset: down.dot(corner) as f32,
            first_row,
            end_row,
            first_column,
            end_column,
        });
    }
    ready.sort_unstable_by(|a, b| b.distance_m.total_cmp(&a.distance_m).then(a.index.cmp(&b.index)));
}

/// The pixels that may show a face: columns and rows from, to. `None`: it is out of sight.
fn bounds(
    face: &Upright,
    corner: Vec3,
    right: Vec3,
    down: Vec3,
    camera: &Camera,
    table: &RayTable,
) -> Option<[usize; 4]> {
    /// Points along each edge: bent edges stay within the margin.
    const STEPS: usize = 12;
    let axis = camera.mounting.vehicle_from_camera().col(2);
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    let (mut seen, mut behind) = (0, 0);
    for i in 0..STEPS {
        let part = i as f64 / STEPS as f64;
        for (s, t) in [(part, 0.0), (1.0, part), (1.0 - part, 1.0), (0.0, 1.0 - part)] {
            let point = corner + right * (s * face.width_m) + down * (t * face.height_m);
            // Lens polynomials fold beyond their range: nothing behind the lens is trusted.
            if (point - camera.mounting.position()).dot(axis) < 1e-3 {
                behind += 1;
            } else if let Some(pixel) = camera.pixel_from_point(point) {
                (low, high) = (low.min(pixel), high.max(pixel));
                seen += 1;
            }
        }
    }
    if seen == 0 {
        return None;
    }
    if behind > 0 {
        return Some([0, table.width, 0, table.height]);
    }
    let margin = 2.0 + 0.02 * (high - low).max_element();
    let range = |low: f64, high: f64, most: usize| {
        let from = (low - margin).clamp(0.0, most as f64) as usize;
        let to = (high + margin).ceil().clamp(0.0, most as f64) as usize;
        (from < to).then_some((from, to))
    };
    let (first_column, end_column) = range(low.x, high.x, table.width)?;
    let (first_row, end_row) = range(low.y, high.y, table.height)?;
    Some([first_column, end_column, first_row, end_row])
}

/// Draws the faces' pixels of row `v` over its colours.
pub(super) fn draw_row(faces: &[Upright], ready: &[Ready], table: &RayTable, v: usize, row: &mut [Colours]) {
    let columns = table.groups_per_row * GROUP;
    for item in ready {
        if !(item.first_row..item.end_row).contains(&v) {
            continue;
        }
        let face = &faces[item.index];
        let (width, height) = (face.width_m as f32, face.height_m as f32);
        let texels = face.texels_per_m.map(|value| value as f32);
        let pitch = table.pitch_rad as f32;
        let picture = &face.looks()[item.look];
        let rays = &table.directions[v * columns + item.first_column..v * columns + item.end_column];
        for (u, ray) in (item.first_column..).zip(rays) {
            let steep = dot(item.normal, *ray);
            if steep > -1e-6 {
                continue;
            }
            let distance = item.offset / steep;
            let s = distance * dot(item.right, *ray) - item.right_offset;
            let t = distance * dot(item.down, *ray) - item.down_offset;
            // A pixel's size on the face, across and along its slant.
            let pixel = distance * pitch;
            let slanted = pixel / -steep;
            let (size_s, size_t) = (
                between_sizes(pixel, slanted, dot(item.right, *ray)),
                between_sizes(pixel, slanted, dot(item.down, *ray)),
            );
            let cover_s = covered(s, width, size_s);
            let cover_t = covered(t, height, size_t);
            let cover = cover_s * cover_t;
            if cover <= 0.0 {
                continue;
            }
            let texel = size_s.max(size_t) * texels[0].max(texels[1]) * 0.7;
            // Logarithm (base 2) from the exponent's bits: the same everywhere.
            let level = ((texel.max(1.0).to_bits() >> 23) - 127).min(12);
            let [colour @ .., opaque] = picture.look(
                s.clamp(0.0, width) * texels[0],
                t.clamp(0.0, height) * texels[1],
                level,
            );
            let part = match face.tree {
                None => (cover * 256.0) as i32,
                Some(_) => (cover * opaque as f32 * (256.0 / (255.0 * 127.0))) as i32,
            };
            let out = &mut row[u / GROUP][4 * (u % GROUP)..][..4];
            for c in 0..3 {
                let old = i32::from(out[c]);
                out[c] = (old + (((colour[c] - old) * part) >> 8)) as i16;
            }
            out[3] = ((i32::from(out[3]) * (256 - part)) >> 8) as i16;
        }
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Size of a pixel along an axis of the face: `slanted` if the ray runs along that axis, `pixel` if across.
fn between_sizes(pixel: f32, slanted: f32, along: f32) -> f32 {
    pixel + (slanted - pixel) * along.abs().min(1.0)
}

/// How much of a pixel of `size` at `place` lies within 0..`extent`.
fn covered(place: f32, extent: f32, size: f32) -> f32 {
    let from_edge = if place < extent - place {
        place
    } else {
        extent - place
    };
    // A face thinner than a pixel covers only part of it.
    let most = (extent / size).min(1.0);
    // A quarter of a pixel more than its own: so little of the floor shows through where two faces of a box meet.
    (from_edge / size + 0.75).clamp(0.0, most)
}

const _: () = assert!(
    COLOUR_SCALE == 127,
    "looks of textures and kernels have one scale"
);
