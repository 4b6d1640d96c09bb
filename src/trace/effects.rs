use std::fmt;

use crate::input::{nearest_word, unknown_word_message};
use crate::scene::Scene;

/// How often light may be reflected by the static environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Bounces {
    /// 0 is direct light, that of emissive geometry included.
    Count(u32),
    /// Until Russian roulette ends the path.
    Infinite,
}

/// What is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Effects {
    /// Static geometry blocks light.
    pub shadows: bool,
    /// Static geometry sends light: its emission, and what it reflects. `None`: it sends none. Implies `shadows`.
    pub bounces: Option<Bounces>,
}

/// What a user asked for: fixed effects, or those that the scene calls for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffectsChoice {
    Auto,
    Fixed(Effects),
}

/// What a scene and its lights hold, as far as it decides about effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SceneFacts {
    /// Lights of the layout.
    pub lights: usize,
    /// Triangles of static geometry.
    pub static_triangles: usize,
    /// Some static surface has an albedo.
    pub reflects: bool,
    /// Some static surface has an emission.
    pub emits: bool,
    /// Some receiver's material has a wrap.
    pub wrap: bool,
}

impl SceneFacts {
    /// Of a scene under so many lights.
    pub fn of(scene: &Scene, lights: usize) -> Self {
        let any = |holds: fn(&[f64; 3], &[f64; 3]) -> bool| {
            scene.statics.iter().any(|object| holds(&object.material.albedo, &object.material.emission))
        };
        Self {
            lights,
            static_triangles: scene.statics.iter().map(|object| object.mesh.triangles.len()).sum(),
            reflects: any(|albedo, _| albedo.iter().any(|a| *a > 0.0)),
            emits: any(|_, emission| emission.iter().any(|e| *e > 0.0)),
            wrap: scene.receivers.iter().any(|receiver| receiver.material.wrap > 0.0),
        }
    }
}

impl Effects {
    /// The lights of the layout, nothing blocks.
    pub const NONE: Self = Self { shadows: false, bounces: None };
    /// The lights of the layout behind static geometry that sends no light.
    pub const SHADOWS: Self = Self { shadows: true, bounces: None };

    pub const fn bounces(bounces: Bounces) -> Self {
        Self { shadows: true, bounces: Some(bounces) }
    }

    /// The effects that a scene calls for, and why each is simulated or left out.
    pub fn called_for(facts: &SceneFacts) -> (Self, Vec<String>) {
        let lit = facts.lights > 0 || facts.emits;
        let mut reasons = Vec::new();
        let effects = if facts.static_triangles == 0 {
            reasons.push("no shadow rays: no static geometry".to_owned());
            reasons.push("no bounces: no static geometry".to_owned());
            Self::NONE
        } else if !lit {
            reasons.push("no shadow rays and no bounces: nothing emits light".to_owned());
            Self::NONE
        } else {
            match facts.lights {
                0 => reasons.push("no shadow rays to lights: the layout has none".to_owned()),
                _ => reasons.push(format!("shadow rays: {} static triangles", facts.static_triangles)),
            }
            reasons.push(match facts.emits {
                true => "emissive geometry: a static material has an emission".to_owned(),
                false => "no sampling of emissive geometry: no static material has an emission".to_owned(),
            });
            match facts.reflects {
                true => {
                    reasons.push("bounces without end: a static material has an albedo".to_owned());
                    Self::bounces(Bounces::Infinite)
                }
                false => {
                    reasons.push("no bounces: every static material has albedo 0".to_owned());
                    if facts.emits { Self::bounces(Bounces::Count(0)) } else { Self::SHADOWS }
                }
            }
        };
        reasons.push(match facts.wrap {
            true => "wrap lobe: a receiver's material has a wrap".to_owned(),
            false => "no wrap lobe: every receiver has wrap 0".to_owned(),
        });
        (effects, reasons)
    }

    /// How often light may be reflected; `None` without end.
    pub fn most_bounces(&self) -> Option<u32> {
        match self.bounces {
            None => Some(0),
            Some(Bounces::Count(count)) => Some(count),
            Some(Bounces::Infinite) => None,
        }
    }
}

impl fmt::Display for Effects {
    /// The words of [`EffectsChoice::parse`]; one text for one value.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.shadows, self.bounces) {
            (_, Some(Bounces::Count(count))) => write!(f, "bounces={count}"),
            (_, Some(Bounces::Infinite)) => f.write_str("bounces=inf"),
            (true, None) => f.write_str("shadows"),
            (false, None) => f.write_str("none"),
        }
    }
}

impl EffectsChoice {
    /// `none`, `auto`, or a comma list of `shadows`, `bounces=N`, `bounces=inf`. The error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        const WORDS: [&str; 5] = ["none", "auto", "shadows", "bounces=N", "bounces=inf"];
        match text.trim() {
            "none" => return Ok(Self::Fixed(Effects::NONE)),
            "auto" => return Ok(Self::Auto),
            _ => {}
        }
        let mut effects = Effects::NONE;
        for word in text.split(',').map(str::trim) {
            let bounces = match word.split_once('=').map(|(key, value)| (key.trim(), value.trim())) {
                Some(("bounces", "inf")) => Some(Bounces::Infinite),
                Some(("bounces", count)) => {
                    let count = count.parse().map_err(|_| {
                        format!("`bounces={count}`: a number of bounces is a whole number from 0, or `inf`")
                    })?;
                    Some(Bounces::Count(count))
                }
                None if word == "shadows" => None,
                _ if word == "none" || word == "auto" => {
                    return Err(format!("`{word}` stands alone, it cannot be part of the list `{text}`"));
                }
                _ => {
                    let mut message = unknown_word_message("effect", word, &WORDS);
                    if let Some(near) = nearest_word(word, WORDS) {
                        message += &format!("; did you mean `{near}`?");
                    }
                    return Err(message);
                }
            };
            if bounces.is_some() && effects.bounces.is_some() {
                return Err(format!("`{text}` says twice how many bounces"));
            }
            effects.shadows = true;
            effects.bounces = effects.bounces.or(bounces);
        }
        Ok(Self::Fixed(effects))
    }

    /// The effects to simulate, and why.
    pub fn resolve(self, facts: &SceneFacts) -> (Effects, Vec<String>) {
        match self {
            Self::Auto => Effects::called_for(facts),
            Self::Fixed(effects) => (effects, vec![format!("{effects}: as was asked for")]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_written_back() {
        for (text, effects) in [
            ("none", Effects::NONE),
            ("shadows", Effects::SHADOWS),
            ("bounces=0", Effects::bounces(Bounces::Count(0))),
            ("bounces=3", Effects::bounces(Bounces::Count(3))),
            ("bounces=inf", Effects::bounces(Bounces::Infinite)),
        ] {
            assert_eq!(EffectsChoice::parse(text), Ok(EffectsChoice::Fixed(effects)));
            assert_eq!(effects.to_string(), text);
        }
        assert_eq!(
            EffectsChoice::parse("shadows, bounces=2"),
            Ok(EffectsChoice::Fixed(Effects::bounces(Bounces::Count(2))))
        );
        assert_eq!(EffectsChoice::parse("auto"), Ok(EffectsChoice::Auto));
        for wrong in
            ["", "shadow", "bounces", "bounces=", "bounces=-1", "bounces=1,bounces=2", "none,shadows", "bounces=1.5"]
        {
            assert!(EffectsChoice::parse(wrong).is_err(), "`{wrong}` must not pass");
        }
        assert!(EffectsChoice::parse("shadow").unwrap_err().contains("did you mean `shadows`"));
    }

    #[test]
    fn a_scene_calls_for_what_it_holds() {
        let full = SceneFacts { lights: 2, static_triangles: 12, reflects: true, emits: true, wrap: true };
        assert_eq!(Effects::called_for(&full).0, Effects::bounces(Bounces::Infinite));
        assert_eq!(Effects::called_for(&SceneFacts { static_triangles: 0, ..full }).0, Effects::NONE);
        assert_eq!(Effects::called_for(&SceneFacts { reflects: false, ..full }).0, Effects::bounces(Bounces::Count(0)));
        let black = SceneFacts { reflects: false, emits: false, ..full };
        assert_eq!(Effects::called_for(&black).0, Effects::SHADOWS);
        assert_eq!(Effects::called_for(&SceneFacts { lights: 0, emits: false, ..full }).0, Effects::NONE);
        let (_, reasons) = Effects::called_for(&SceneFacts { wrap: false, ..black });
        assert!(
            reasons.iter().any(|r| r.starts_with("no wrap lobe"))
                && reasons.iter().any(|r| r.starts_with("no bounces"))
        );
    }
}
