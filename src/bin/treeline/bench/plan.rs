//! Which configurations are measured, and their names on the command line of the processes that measure them.

use super::{
    BenchArgs,
    scenes::{SceneArg, View},
};
use std::{fmt, str::FromStr};

/// One technique drawing one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    /// With its variants: `lod+msaa4`.
    pub technique: String,
    pub instances: u64,
    pub view: View,
}

impl Configuration {
    /// `camera` of the row.
    pub fn camera(&self) -> String {
        match self.view {
            View::Still => "still".into(),
            View::Flying => "flying".into(),
            View::Distance(distance) => format!("still at {distance}"),
        }
    }

    /// Part of file names.
    pub fn file_stem(&self) -> String {
        let view = match self.view {
            View::Distance(distance) => format!("at_{distance}"),
            _ => self.camera(),
        };
        format!("{}_{}_{view}", self.technique, self.instances)
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let view = match self.view {
            View::Still => "still".into(),
            View::Flying => "flying".into(),
            View::Distance(distance) => distance.to_string(),
        };
        write!(f, "{}@{}@{view}", self.technique, self.instances)
    }
}

impl FromStr for Configuration {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not TECHNIQUE@INSTANCES@VIEW");
        let [technique, instances, view] =
            <[&str; 3]>::try_from(text.split('@').collect::<Vec<_>>()).map_err(|_| wrong())?;
        let view = match view {
            "still" => View::Still,
            "flying" => View::Flying,
            distance => View::Distance(distance.parse().map_err(|_| wrong())?),
        };
        let instances = instances.parse().map_err(|_| wrong())?;
        Ok(Self { technique: technique.to_owned(), instances, view })
    }
}

/// All of them, in the order of a round: counts ascending as given, techniques side by side.
pub fn configurations(args: &BenchArgs, distances: &[f32]) -> Vec<Configuration> {
    let scenes: Vec<(u64, View)> = if args.scene == SceneArg::Single {
        distances.iter().map(|&distance| (1, View::Distance(distance))).collect()
    } else {
        args.instances.iter().map(|&instances| (instances, args.camera.view())).collect()
    };
    let all = scenes.into_iter().flat_map(|(instances, view)| {
        let of = move |technique: &String| Configuration {
            technique: technique.clone(),
            instances,
            view,
        };
        args.techniques.iter().map(of)
    });
    all.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_survives_the_command_line() {
        for view in [View::Still, View::Flying, View::Distance(12.5)] {
            let technique = "lod+msaa4".to_owned();
            let configuration = Configuration { technique, instances: 10_000_000, view };
            assert_eq!(configuration.to_string().parse(), Ok(configuration));
        }
        assert!("points@many@still".parse::<Configuration>().is_err());
        assert!("points".parse::<Configuration>().is_err());
    }
}
