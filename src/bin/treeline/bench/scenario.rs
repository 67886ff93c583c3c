//! What rows share that may be shown together: everything but the technique and the position, which is the number of trees,
//! or in the scene `single` the distance of the one.

use super::{
    format::{count, tick},
    row::Row,
};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scenario {
    pub scene: String,
    pub species: String,
    pub size: String,
    pub camera: String,
}

impl Scenario {
    pub fn of(row: &Row) -> Self {
        Self {
            scene: row.scene.clone(),
            species: row.species.clone(),
            size: row.size.clone(),
            camera: row.camera.split(" at ").next().unwrap_or_default().to_owned(),
        }
    }

    /// For people: `baseline, sapling_quaking_aspen, 1280x720, still camera`.
    pub fn title(&self) -> String {
        format!("{}, {}, {}, {} camera", self.scene, self.species, self.size, self.camera)
    }

    /// For file names: letters and digits, `_` for what lies between.
    pub fn file_name(&self) -> String {
        let text = [&*self.scene, &*self.species, &*self.size, &*self.camera].join(" ");
        let words =
            text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        words.collect::<Vec<_>>().join("_")
    }
}

/// Where a row stands among those of its scenario.
pub fn position(row: &Row) -> f64 {
    row.distance().unwrap_or(row.instances as f64)
}

/// The same for people: `10k`, or `at 12.5`.
pub fn position_text(row: &Row) -> String {
    row.distance().map_or_else(|| count(row.instances), |distance| format!("at {}", tick(distance)))
}

/// What positions are.
pub fn position_name(rows: &[&Row]) -> &'static str {
    if rows.iter().any(|row| row.distance().is_some()) {
        "distance of the tree"
    } else {
        "trees in the scene"
    }
}

/// The rows by scenario, both in the order in which they first appear.
pub fn by_scenario(rows: &[Row]) -> Vec<(Scenario, Vec<&Row>)> {
    let mut groups: Vec<(Scenario, Vec<&Row>)> = vec![];
    for row in rows {
        let scenario = Scenario::of(row);
        match groups.iter_mut().find(|(known, _)| *known == scenario) {
            Some((_, members)) => members.push(row),
            None => groups.push((scenario, vec![row])),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_tree_at_several_distances_is_one_scenario() {
        let row = |camera: &str| Row { camera: camera.into(), instances: 1, ..Default::default() };
        let (near, far) = (row("still at 12.5"), row("still at 100"));
        assert_eq!(Scenario::of(&near), Scenario::of(&far));
        assert_eq!((position(&near), position_text(&near)), (12.5, "at 12.5".to_owned()));
        assert_eq!(position_name(&[&near, &far]), "distance of the tree");
        let forest = Row { instances: 10_000, ..row("flying") };
        assert_eq!((position(&forest), position_text(&forest)), (1e4, "10k".to_owned()));
        assert_ne!(Scenario::of(&near), Scenario::of(&forest));
    }

    #[test]
    fn rows_that_may_be_compared_come_together_in_their_order() {
        let row = |species: &str, technique: &str| Row {
            scene: "baseline".into(),
            species: species.into(),
            size: "1280x720".into(),
            camera: "still".into(),
            technique: technique.into(),
            ..Default::default()
        };
        let rows = [row("oak+fir", "stock"), row("aspen", "stock"), row("oak+fir", "points")];
        let groups = by_scenario(&rows);
        let techniques: Vec<Vec<&str>> = groups
            .iter()
            .map(|(_, rows)| rows.iter().map(|row| &*row.technique).collect())
            .collect();
        assert_eq!(techniques, [vec!["stock", "points"], vec!["stock"]]);
        assert_eq!(groups[0].0.title(), "baseline, oak+fir, 1280x720, still camera");
        assert_eq!(groups[0].0.file_name(), "baseline_oak_fir_1280x720_still");
    }
}
