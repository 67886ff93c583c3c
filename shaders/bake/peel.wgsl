// Depth peeling (Bærentzen 2005, §2): one draw of all triangles renders one layer.
//
// In: triangle corners in a storage buffer, the depths of the layer before. Out: per pixel the nearest fragment
// behind that depth: (triangle + 1, octahedral normal, sRGB albedo, depth bits), all 0 where there is none.
//
// The paper's two depth buffers are two textures used in turn: the fixed-function test (LESS) keeps the nearest
// fragment, and the comparison with `previous_depth` below rejects the layers already peeled. Both see the same
// number, because the depth is computed here and written as `frag_depth`. Everything is interpolated here, from corners
// snapped to 1/256 pixel, so that neither the adapter's arithmetic nor the tile changes the result.

struct PeelView {
    right: vec3f,
    // Side of a pixel, in model units.
    pixel: f32,
    up: vec3f,
    // Extent along `forward`, in model units.
    depth: f32,
    forward: vec3f,
    direction: u32,
    origin: vec3f,
    tile_width: u32,
    // LDI pixel of the tile's first pixel.
    tile_origin: vec2f,
    // Part of the LDI that clip space spans: all of it, so that tiles clip nothing. Sides are powers of two, so that the
    // way to clip space and back is exact.
    clip_origin: vec2f,
    clip_size: vec2f,
    tile_height: u32,
    pad: u32,
}

struct PeelDraw {
    // Linear.
    base_color: vec4f,
    // Below it a fragment is a hole; −1 for opaque materials.
    alpha_cutoff: f32,
    // Number in the model of the chunk's first triangle.
    first_triangle: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> view: PeelView;
@group(0) @binding(1) var previous_depth: texture_depth_2d;
@group(1) @binding(0) var<uniform> draw: PeelDraw;
// Three a corner: (position, u), (normal, v), linear colour.
@group(1) @binding(1) var<storage, read> corners: array<vec4f>;
@group(1) @binding(2) var base_color_texture: texture_2d<f32>;
@group(1) @binding(3) var base_color_sampler: sampler;
// Fragments behind the last layer, spread over 256 counters.
@group(2) @binding(0) var<storage, read_write> left_over: array<atomic<u32>, 256>;

// Share of the depth range left free at both ends: 0 and 1 are the cleared values, and rounding must not reach them.
const DEPTH_MARGIN: f32 = 1.0 / 1024.0;
// Normal too short to have a direction; the face normal is used instead.
const NO_NORMAL: u32 = 0xffffffffu;

// All of it per triangle; what a pixel gets is interpolated below.
struct PeelVarying {
    @builtin(position) clip: vec4f,
    // The triangle's corners, sorted.
    @location(0) @interpolate(flat) corners: vec3u,
    // The first in LDI pixels and depth, and the way from it to the others.
    @location(1) @interpolate(flat) anchor: vec3f,
    @location(2) @interpolate(flat) side1: vec3f,
    @location(3) @interpolate(flat) side2: vec3f,
}

struct PeelFragment {
    @location(0) layer: vec4u,
    @builtin(frag_depth) depth: f32,
}

struct LdiCorner {
    // LDI pixels (snapped) and depth (0 to 1, within the margins).
    place: vec3f,
    corner: u32,
}

fn ldi_corner(corner: u32) -> LdiCorner {
    let p = corners[3u * corner].xyz - view.origin;
    let xy = vec2f(dot(p, view.right), dot(p, view.up)) / view.pixel;
    let z = dot(p, view.forward) / view.depth;
    let place = vec3f(floor(xy * 256.0 + 0.5) / 256.0, DEPTH_MARGIN + z * (1.0 - 2.0 * DEPTH_MARGIN));
    return LdiCorner(place, corner);
}

fn is_before(a: vec3f, b: vec3f) -> bool {
    if a.x != b.x { return a.x < b.x; }
    if a.y != b.y { return a.y < b.y; }
    return a.z < b.z;
}

@vertex
fn peel_vertex(@builtin(vertex_index) vertex: u32) -> PeelVarying {
    let first = vertex - vertex % 3u;
    var a = ldi_corner(first);
    var b = ldi_corner(first + 1u);
    var c = ldi_corner(first + 2u);
    var here = a.place.xy;
    if vertex % 3u == 1u { here = b.place.xy; }
    if vertex % 3u == 2u { here = c.place.xy; }

    // Sorted, so that triangles with the same corners get the same depths to the last bit, whatever their winding.
    var swap = a;
    if is_before(b.place, a.place) { swap = a; a = b; b = swap; }
    if is_before(c.place, b.place) { swap = b; b = c; c = swap; }
    if is_before(b.place, a.place) { swap = a; a = b; b = swap; }

    let ndc = (here - view.clip_origin) * (2.0 / view.clip_size) - 1.0;
    var out: PeelVarying;
    // Rows grow downwards in the target. No clipping in depth: `is_peeled` rejects what is outside.
    out.clip = vec4f(ndc.x, -ndc.y, 0.5, 1.0);
    out.corners = vec3u(a.corner, b.corner, c.corner);
    out.anchor = a.place;
    out.side1 = b.place - a.place;
    out.side2 = c.place - a.place;
    return out;
}

fn cross2(a: vec2f, b: vec2f) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Weights of the second and third corner at the pixel's centre.
fn corner_weights(in: PeelVarying) -> vec2f {
    let d = in.clip.xy + view.tile_origin - in.anchor.xy;
    let w = vec2f(cross2(d, in.side2.xy), cross2(in.side1.xy, d)) / cross2(in.side1.xy, in.side2.xy);
    // Clamped: slivers are badly conditioned, and must not reach beyond their corners.
    let w1 = clamp(w.x, 0.0, 1.0);
    return vec2f(w1, clamp(w.y, 0.0, 1.0 - w1));
}

fn fragment_depth(in: PeelVarying, weights: vec2f) -> f32 {
    return in.anchor.z + weights.x * in.side1.z + weights.y * in.side2.z;
}

// Part `part` of a corner (see `corners`) at the weights.
fn interpolate_corners(in: PeelVarying, weights: vec2f, part: u32) -> vec4f {
    let a = corners[3u * in.corners.x + part];
    let b = corners[3u * in.corners.y + part];
    let c = corners[3u * in.corners.z + part];
    return a * (1.0 - weights.x - weights.y) + b * weights.x + c * weights.y;
}

fn base_color(normal_v: vec4f, in: PeelVarying, weights: vec2f) -> vec4f {
    let uv = vec2f(interpolate_corners(in, weights, 0u).w, normal_v.w);
    let texel = textureSampleLevel(base_color_texture, base_color_sampler, uv, 0.0);
    return draw.base_color * interpolate_corners(in, weights, 2u) * texel;
}

// Behind the layer before, and within the depth range.
fn is_behind(in: PeelVarying, depth: f32) -> bool {
    return depth > textureLoad(previous_depth, vec2u(in.clip.xy), 0) && depth < 1.0;
}

// Bytes of the sRGB code, rounded to nearest; packed here so that no adapter rounds its own way.
fn srgb8_from_linear(linear: vec3f) -> u32 {
    let c = clamp(linear, vec3f(0.0), vec3f(1.0));
    let high = 1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055;
    let srgb = select(high, c * 12.92, c <= vec3f(0.0031308));
    let bytes = vec3u(srgb * 255.0 + 0.5);
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u);
}

fn sign_not_zero(v: vec2f) -> vec2f {
    return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

// Twin of `math::octahedral::encode_bits(.., 16, 16)`.
fn octahedral16_from_normal(n: vec3f) -> u32 {
    let sum = abs(n.x) + abs(n.y) + abs(n.z);
    if !(sum > 1e-6 && sum < 1e6) { return NO_NORMAL; }
    let p = n / sum;
    let folded = (1.0 - abs(p.yx)) * sign_not_zero(p.xy);
    let e = select(folded, p.xy, p.z >= 0.0);
    let q = vec2u((e + 1.0) * 32767.0 + 0.5);
    return q.x | (q.y << 16u);
}

@fragment
fn peel_fragment(in: PeelVarying) -> PeelFragment {
    let weights = corner_weights(in);
    let depth = fragment_depth(in, weights);
    if !is_behind(in, depth) { discard; }
    let normal_v = interpolate_corners(in, weights, 1u);
    let color = base_color(normal_v, in, weights);
    if color.a < draw.alpha_cutoff { discard; }
    let number = draw.first_triangle + in.corners.x / 3u + 1u;
    let normal = octahedral16_from_normal(normal_v.xyz);
    return PeelFragment(vec4u(number, normal, srgb8_from_linear(color.rgb), bitcast<u32>(depth)), depth);
}

// Counts what lies behind the last layer allowed. Drawn once, without depth test.
@fragment
fn count_left_over(in: PeelVarying) {
    let weights = corner_weights(in);
    if !is_behind(in, fragment_depth(in, weights)) { discard; }
    let color = base_color(interpolate_corners(in, weights, 1u), in, weights);
    if color.a < draw.alpha_cutoff { discard; }
    let pixel = vec2u(in.clip.xy) & vec2u(15u);
    atomicAdd(&left_over[pixel.y * 16u + pixel.x], 1u);
}

// Compaction: keeps the fragments of a layer that its direction keeps, in row-major order.
//
// In: the layer drawn above. Out: records appended behind those of the batch's earlier layers. Three dispatches: count
// per block of 256 pixels, exclusive scan of the counts, write. So the order never depends on which thread was first,
// and only what is kept travels to the CPU.

struct LayerCount {
    // Pixels with a fragment.
    covered: atomic<u32>,
    // Fragments this direction keeps.
    kept: u32,
}

struct BatchHeader {
    // Layers of the batch compacted so far.
    layer: u32,
    // Records of those layers.
    total: u32,
    counts: array<LayerCount>,
}

struct PeelRecord {
    // LDI column | row << 16.
    cell: u32,
    depth: f32,
    triangle: u32,
    normal: u32,
    albedo: u32,
}

@group(3) @binding(0) var layer: texture_2d<u32>;
// The direction that keeps each triangle, four to a word.
@group(3) @binding(1) var<storage, read> triangle_directions: array<u32>;
@group(3) @binding(2) var<storage, read_write> header: BatchHeader;
@group(3) @binding(3) var<storage, read_write> blocks: array<u32>;
@group(3) @binding(4) var<storage, read_write> records: array<PeelRecord>;

const BLOCK: u32 = 256u;

var<workgroup> covered_mask: array<atomic<u32>, 8>;
var<workgroup> kept_mask: array<atomic<u32>, 8>;
var<workgroup> sums: array<u32, 256>;

fn block_count() -> u32 {
    return (view.tile_width * view.tile_height + BLOCK - 1u) / BLOCK;
}

fn load_fragment(pixel: u32) -> vec4u {
    if pixel >= view.tile_width * view.tile_height { return vec4u(0u); }
    return textureLoad(layer, vec2u(pixel % view.tile_width, pixel / view.tile_width), 0);
}

fn is_kept(fragment: vec4u) -> bool {
    if fragment.x == 0u { return false; }
    let triangle = fragment.x - 1u;
    return ((triangle_directions[triangle / 4u] >> (8u * (triangle % 4u))) & 255u) == view.direction;
}

@compute @workgroup_size(256)
fn count_blocks(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let fragment = load_fragment(group.x * BLOCK + local);
    if fragment.x != 0u { atomicOr(&covered_mask[local / 32u], 1u << (local % 32u)); }
    if is_kept(fragment) { atomicOr(&kept_mask[local / 32u], 1u << (local % 32u)); }
    workgroupBarrier();
    if local != 0u { return; }
    var covered = 0u;
    var kept = 0u;
    for (var i = 0u; i < 8u; i++) {
        covered += countOneBits(atomicLoad(&covered_mask[i]));
        kept += countOneBits(atomicLoad(&kept_mask[i]));
    }
    blocks[group.x] = kept;
    if covered != 0u { atomicAdd(&header.counts[header.layer].covered, covered); }
}

// One workgroup: turns the counts into offsets and moves the header to the next layer.
@compute @workgroup_size(256)
fn scan_blocks(@builtin(local_invocation_index) local: u32) {
    let count = block_count();
    let per_thread = (count + BLOCK - 1u) / BLOCK;
    let first = min(local * per_thread, count);
    let end = min(first + per_thread, count);
    var sum = 0u;
    for (var i = first; i < end; i++) { sum += blocks[i]; }
    sums[local] = sum;
    workgroupBarrier();
    // Inclusive scan of the 256 sums (Hillis and Steele 1986).
    for (var stride = 1u; stride < BLOCK; stride *= 2u) {
        var before = 0u;
        if local >= stride { before = sums[local - stride]; }
        workgroupBarrier();
        sums[local] += before;
        workgroupBarrier();
    }
    let base = header.total;
    var offset = base + sums[local] - sum;
    for (var i = first; i < end; i++) {
        let kept = blocks[i];
        blocks[i] = offset;
        offset += kept;
    }
    storageBarrier();
    workgroupBarrier();
    if local != 0u { return; }
    header.counts[header.layer].kept = sums[BLOCK - 1u];
    header.total = base + sums[BLOCK - 1u];
    header.layer += 1u;
}

@compute @workgroup_size(256)
fn write_records(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let pixel = group.x * BLOCK + local;
    let fragment = load_fragment(pixel);
    let kept = is_kept(fragment);
    if kept { atomicOr(&kept_mask[local / 32u], 1u << (local % 32u)); }
    workgroupBarrier();
    if !kept { return; }
    var rank = countOneBits(atomicLoad(&kept_mask[local / 32u]) & ((1u << (local % 32u)) - 1u));
    for (var i = 0u; i < local / 32u; i++) { rank += countOneBits(atomicLoad(&kept_mask[i])); }
    let cell = vec2u(view.tile_origin) + vec2u(pixel % view.tile_width, pixel / view.tile_width);
    records[blocks[group.x] + rank] = PeelRecord(
        cell.x | (cell.y << 16u),
        bitcast<f32>(fragment.w),
        fragment.x - 1u,
        fragment.y,
        fragment.z,
    );
}
