//! What rows share that may be compared with each other: everything but technique and number of instances.

use super::row::Row;

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
            camera: row.camera.clone(),
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
