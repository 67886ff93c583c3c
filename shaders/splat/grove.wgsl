// A sample of a grove: a tree of its block and the rank of one of its points. It is drawn exactly where the tree itself
// would draw that point, so the change from trees to grove shows nothing.
#define_import_path bevy_treeline::grove

#import bevy_treeline::instance::{matrix_of, rotation_of, species_of, tree_instance}
#import bevy_treeline::lod::{disc_radius, factor_between, factor_place, factor_words, grove_point, grove_sample}
#import bevy_treeline::selection::wanted_points
#import bevy_treeline::splat_bindings::{looks, places, samples, settings, species, view}
#import bevy_treeline::splat_item::{COUNT, GROVE_UNIT, splat_item}
#import bevy_treeline::types::SplatItem

// The item that a lane draws its one point of: with no points if the tree does not deserve it.
fn grove_item(shared_item: SplatItem, lane: u32) -> SplatItem {
    var item = shared_item;
    let is_there = lane < (item.count_flags & COUNT);
    let place = item.first_point + select(0u, lane, is_there);
    let sample = grove_sample(samples[place >> 1u], place);
    let index = (item.count_flags >> 8u) * GROVE_UNIT + (sample >> 8u);
    let instance = tree_instance(places[index], looks[index]);
    let kind_index = species_of(instance.look);
    let kind = species[kind_index];
    let center = instance.position + matrix_of(rotation_of(instance.look)) * (kind.center * instance.scale);
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let d = select(distance(center, eye), 1.0, settings.orthographic != 0u);
    let wanted = wanted_points(settings, instance, kind, d, item.area, item.leaf_overlap);
    let step = factor_place(wanted.full, f32(kind.point_count));
    let words = factor_words(step);
    let factor = factor_between(species[kind_index].area_factors[words.x], species[kind_index].area_factors[words.y], step);
    let radius = disc_radius(kind.surface_area * instance.scale * instance.scale * factor, wanted.full);
    let rank = sample & 0xffu;
    item = splat_item(view.view_from_world, instance, kind, kind.first_point + grove_point(rank, settings.window, kind.point_count), 1u, radius, settings.overlap_gain, settings.splat_shape);
    item.count_flags = select(0u, item.count_flags, is_there && rank < wanted.count);
    return item;
}
