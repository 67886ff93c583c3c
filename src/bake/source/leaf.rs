//! Foliage or wood? A material's name, alpha, sides and colour → yes or no. O(length of the name).

use bevy::math::Vec4;

const LEAF_WORDS: [&str; 8] =
    ["leaf", "leaves", "foliage", "needle", "frond", "blossom", "flower", "grass"];
const WOOD_WORDS: [&str; 6] = ["bark", "trunk", "wood", "branch", "twig", "stem"];

/// How much stronger green must be than red and blue (linear) for a colour alone to mean foliage.
const GREEN_RATIO: f32 = 1.2;

/// Says whether a material is foliage.
///
/// The name counts most: a leaf word makes foliage, a wood word wood. With both ("cottonwood leaves", "leafy branch")
/// or neither, it is foliage if alpha is cut or blended or both sides are seen; with neither also if its colour is
/// clearly green, as in solid-coloured models.
pub fn is_leaf(name: &str, alpha_cut: bool, double_sided: bool, base_color: Vec4) -> bool {
    let name = name.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    let [r, g, b, _] = base_color.to_array();
    let thin = alpha_cut || double_sided;
    match (has(&LEAF_WORDS), has(&WOOD_WORDS)) {
        (true, false) => true,
        (false, true) => false,
        (true, true) => thin,
        (false, false) => thin || (g > GREEN_RATIO * r && g > GREEN_RATIO * b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foliage_is_told_from_wood() {
        let green = Vec4::new(0.07, 0.12, 0.05, 1.0);
        let brown = Vec4::new(0.12, 0.06, 0.05, 1.0);
        for (name, alpha_cut, double_sided, color, expected) in [
            ("Leaves", false, false, brown, true),
            ("leaves.003", true, true, Vec4::ONE, true),
            ("bark_oak", false, false, Vec4::ONE, false),
            ("Trunk", false, true, green, false),
            ("Branches", true, true, Vec4::ONE, false),
            ("CottonWood_Leaves", true, true, Vec4::ONE, true),
            ("leafless_twig", false, false, green, false),
            ("Material", false, true, Vec4::ONE, true),
            ("Green", false, false, green, true),
            ("Wood", false, false, brown, false),
            ("", false, false, Vec4::ONE, false),
        ] {
            let found = is_leaf(name, alpha_cut, double_sided, color);
            assert_eq!(found, expected, "{name} {alpha_cut} {double_sided} {color}");
        }
    }
}
