//! figures.tex: every figure of a folder with its caption, ready to be included in a paper.

/// A LaTeX file of `figure` environments: (file name without extension, title, subtitle).
pub fn latex<'a>(figures: impl IntoIterator<Item = (&'a str, &'a str, &'a str)>) -> String {
    let mut out = String::from(
        "% One environment a figure; \\input this file, or copy what you need. Needs \\usepackage{graphicx}.\n\
         % Beside each PNG lie the same figure as SVG (\\includesvg of the package svg) and the CSV that it was drawn from.\n",
    );
    for (name, title, subtitle) in figures {
        let mut caption = escaped(title);
        if !subtitle.is_empty() {
            caption += &format!(". {}", escaped(subtitle));
        }
        out += &format!(
            "\n\\begin{{figure}}\n  \\centering\n  \\includegraphics[width=\\linewidth]{{{name}.png}}\n  \\caption{{{caption}.}}\n  \
             \\label{{fig:{name}}}\n\\end{{figure}}\n"
        );
    }
    out
}

/// Text in which nothing is a command, and no sign is one that LaTeX lacks.
fn escaped(text: &str) -> String {
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
        let text = latex([("front-a_b", "50 % of a_b & c#1 {x}", "2 × 3 · \\end ~^")]);
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
