// How the points of an item come from the grid of their tree's box into view space, and how large their splats are.
#define_import_path bevy_treeline::splat_item

#import bevy_treeline::instance::{TreeInstance, matrix_of, rotation_of}
#import bevy_treeline::lod::{PI, leaf_overlap}
#import bevy_treeline::types::{Species, SplatItem}

// Values of `splat_shape`.
const CELLS: u32 = 0u;
const DISCS: u32 = 1u;
// SplatItem.count_flags: points in 7 bits, then whether the tree was peeled from other directions than X, Y and Z, or
// discs are asked for; the first instance of a grove, in units of GROVE_UNIT, above bit 8.
const COUNT: u32 = 0x7fu;
const AS_DISCS: u32 = 0x80u;
// Slices of instances begin at multiples of it. Twin of `UNIT` in src/render/residency/instances.rs.
const GROVE_UNIT: u32 = 32u;

fn splat_item(view_from_world: mat4x4<f32>, instance: TreeInstance, kind: Species, first_point: u32, count: u32, radius: f32, overlap_gain: f32, splat_shape: u32) -> SplatItem {
    let turned = mat3x3<f32>(view_from_world[0].xyz, view_from_world[1].xyz, view_from_world[2].xyz) * matrix_of(rotation_of(instance.look));
    let foot = (view_from_world * vec4(instance.position, 1.0)).xyz + turned * (kind.lo * instance.scale);
    // World units a step of the grid. A flat model has no steps that way, but its normals need an axis.
    let step = max(kind.extent * instance.scale / vec3(65535.0, 65535.0, 16383.0), vec3(1e-12));
    var item: SplatItem;
    item.row_x = vec4(turned[0].x * step.x, turned[1].x * step.y, turned[2].x * step.z, foot.x);
    item.row_y = vec4(turned[0].y * step.x, turned[1].y * step.y, turned[2].y * step.z, foot.y);
    item.row_z = vec4(turned[0].z * step.x, turned[1].z * step.y, turned[2].z * step.z, foot.z);
    item.inverse_step = 1.0 / step;
    item.first_point = first_point;
    let as_discs = splat_shape == DISCS || (splat_shape == CELLS && kind.sample_share == 0.0);
    let disc_area = PI * radius * radius;
    // A cell is measured along its peeling direction, from where the piece of the surface looks smaller.
    item.area = disc_area * select(1.0, kind.sample_share, splat_shape == CELLS && !as_discs);
    item.leaf_overlap = leaf_overlap(radius, kind.mean_leaf_area * instance.scale * instance.scale, overlap_gain);
    // Mean distance of drawn points in LDI pixels: sqrt(N0 / N), from what each stands for.
    let spacing = radius / (kind.pixel * instance.scale) * sqrt(PI * max(kind.sample_share, 0.6));
    item.half_inverse_spacing = 0.5 / spacing;
    item.count_flags = count | select(0u, AS_DISCS, as_discs);
    return item;
}
