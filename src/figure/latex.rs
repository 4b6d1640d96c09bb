//! figures.tex: every figure of a folder with its caption, ready to be included in a paper.

/// What LaTeX needs to know of a figure.
#[derive(Clone, Debug)]
pub struct Captioned {
    /// File name without extension.
    pub name: String,
    pub title: String,
    pub subtitle: String,
    /// A table: NAME.tex holds its `tabular`.
    pub is_table: bool,
}

/// A LaTeX file of `figure` environments, and of a `table` where a figure is one.
pub fn latex<'a>(figures: impl IntoIterator<Item = &'a Captioned>) -> String {
    let mut out = String::from(
        "% One environment a figure; \\input this file, or copy what you need. Needs \\usepackage{graphicx}.\n\
         % Beside each PNG lie the same figure as SVG (\\includesvg of the package svg) and the CSV that it was drawn from.\n",
    );
    for Captioned { name, title, subtitle, is_table } in figures {
        let mut caption = escaped(title);
        if !subtitle.is_empty() {
            caption += &format!(". {}", escaped(subtitle));
        }
        out += &match is_table {
            false => format!(
                "\n\\begin{{figure}}\n  \\centering\n  \\includegraphics[width=\\linewidth]{{{name}.png}}\n  \\caption{{{caption}.}}\n  \
                 \\label{{fig:{name}}}\n\\end{{figure}}\n"
            ),
            true => format!(
                "\n\\begin{{table}}\n  \\centering\n  \\caption{{{caption}.}}\n  \\label{{tab:{name}}}\n  \\input{{{name}.tex}}\n\
                 \\end{{table}}\n"
            ),
        };
    }
    out
}

/// Text in which nothing is a command, and no sign is one that LaTeX lacks.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '~' => out += "\\textasciitilde{}",
            '^' => out += "\\textasciicircum{}",
            '\\' => out += "\\textbackslash{}",
            '<' | '>' | '|' => out += &format!("${c}$"),
            '·' => out += "$\\cdot$",
            '×' => out += "$\\times$",
            '−' => out += "$-$",
            '±' => out += "$\\pm$",
            '≤' => out += "$\\leq$",
            '≈' => out += "$\\approx$",
            '⁻' => out += "$^{-}$",
            '⁰' | '⁴'..='⁹' => out += &format!("$^{}$", c as u32 - '⁰' as u32),
            '¹' | '²' | '³' => out += &format!("$^{}$", "¹²³".chars().position(|d| d == c).map_or(0, |d| d + 1)),
            '→' => out += "$\\to$",
            'Δ' => out += "$\\Delta$",
            '…' => out += "\\dots{}",
            'µ' => out += "$\\mu$",
            'π' => out += "$\\pi$",
            '°' => out += "$^\\circ$",
            // what else a name may hold: UTF-8 is LaTeX's own encoding
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_caption_is_a_command() {
        let captioned = |name: &str, title: &str, subtitle: &str, is_table| {
            let [name, title, subtitle] = [name, title, subtitle].map(str::to_owned);
            Captioned { name, title, subtitle, is_table }
        };
        let figure = captioned("front-a_b", "50 % of a_b & c#1 {x}", "2 × 3 · \\end ~^", false);
        let text = latex([&figure, &captioned("sizes", "Sizes 10⁻¹⁴", "", true)]);
        assert!(text.contains("\\input{sizes.tex}") && text.contains("Sizes 10$^{-}$$^1$$^4$."), "{text}");
        assert!(
            text.contains("\\caption{50 \\% of a\\_b \\& c\\#1 \\{x\\}. 2 $\\times$ 3 $\\cdot$ \\textbackslash{}end"),
            "{text}"
        );
        assert!(text.contains("\\includegraphics[width=\\linewidth]{front-a_b.png}"), "{text}");
        assert_eq!(text.matches("\\begin{figure}").count(), 1);
        // braces outside of escapes are balanced
        let bare = text.replace("\\{", "").replace("\\}", "");
        assert_eq!(bare.matches('{').count(), bare.matches('}').count());
    }
}
