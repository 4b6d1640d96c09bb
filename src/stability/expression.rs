use std::fmt;

/// A number as a function of the family's parameter `t`, as a file writes it: `"=1 + t"`.
///
/// Sums, products, quotients, powers `a^b`, signs, brackets, the constant `pi` and the functions of [`FUNCTIONS`].
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    Number(f64),
    Parameter,
    Negative(Box<Expression>),
    Binary(char, Box<Expression>, Box<Expression>),
    Call(usize, Box<Expression>),
}

/// The functions that an expression may call, of one argument.
pub const FUNCTIONS: [(&str, fn(f64) -> f64); 7] = [
    ("sqrt", f64::sqrt),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("exp", f64::exp),
    ("log10", f64::log10),
    ("abs", f64::abs),
];

/// Brackets and signs may stand so deep in each other.
const DEEPEST: usize = 60;

impl Expression {
    /// From a text without the leading `=`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut reader = Reader { text, at: 0, depth: 0 };
        let value = reader.sum()?;
        match reader.peek() {
            None => Ok(value),
            Some(found) => Err(format!("`{found}` where the expression should end")),
        }
    }

    pub fn value(&self, t: f64) -> f64 {
        match self {
            Expression::Number(value) => *value,
            Expression::Parameter => t,
            Expression::Negative(inner) => -inner.value(t),
            Expression::Call(function, inner) => FUNCTIONS[*function].1(inner.value(t)),
            Expression::Binary(operator, a, b) => {
                let (a, b) = (a.value(t), b.value(t));
                match operator {
                    '+' => a + b,
                    '-' => a - b,
                    '*' => a * b,
                    '/' => a / b,
                    _ => a.powf(b),
                }
            }
        }
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Expression::Number(value) => write!(f, "{value:?}"),
            Expression::Parameter => f.write_str("t"),
            Expression::Negative(inner) => write!(f, "-({inner})"),
            Expression::Call(function, inner) => write!(f, "{}({inner})", FUNCTIONS[*function].0),
            Expression::Binary(operator, a, b) => write!(f, "({a} {operator} {b})"),
        }
    }
}

struct Reader<'t> {
    text: &'t str,
    at: usize,
    depth: usize,
}

impl Reader<'_> {
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn take(&mut self, wanted: &[char]) -> Option<char> {
        let found = self.peek().filter(|c| wanted.contains(c))?;
        self.at += found.len_utf8();
        Some(found)
    }

    fn chain(
        &mut self,
        operators: &[char],
        part: fn(&mut Self) -> Result<Expression, String>,
    ) -> Result<Expression, String> {
        let mut value = part(self)?;
        while let Some(operator) = self.take(operators) {
            value = Expression::Binary(operator, Box::new(value), Box::new(part(self)?));
        }
        Ok(value)
    }

    fn sum(&mut self) -> Result<Expression, String> {
        self.chain(&['+', '-'], Self::product)
    }

    fn product(&mut self) -> Result<Expression, String> {
        self.chain(&['*', '/'], Self::signed)
    }

    fn signed(&mut self) -> Result<Expression, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err("an expression too deep".to_owned());
        }
        let value = match self.take(&['-']) {
            Some(_) => Expression::Negative(Box::new(self.signed()?)),
            None => self.power()?,
        };
        self.depth -= 1;
        Ok(value)
    }

    fn power(&mut self) -> Result<Expression, String> {
        let base = self.atom()?;
        match self.take(&['^']) {
            Some(operator) => Ok(Expression::Binary(operator, Box::new(base), Box::new(self.signed()?))),
            None => Ok(base),
        }
    }

    fn atom(&mut self) -> Result<Expression, String> {
        match self.peek() {
            Some('(') => self.bracket(),
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() => {
                let rest = &self.text[self.at..];
                let word = &rest[..rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len())];
                self.at += word.len();
                match (word, FUNCTIONS.iter().position(|(name, _)| *name == word)) {
                    ("t", _) => Ok(Expression::Parameter),
                    ("pi", _) => Ok(Expression::Number(std::f64::consts::PI)),
                    (_, Some(function)) => Ok(Expression::Call(function, Box::new(self.bracket()?))),
                    _ => {
                        let names = FUNCTIONS.map(|(name, _)| format!("`{name}`")).join(", ");
                        Err(format!("unknown word `{word}`; allowed: `t`, `pi`, {names}"))
                    }
                }
            }
            Some(other) => Err(format!("`{other}` where a number should stand")),
            None => Err("the expression ends where a number should stand".to_owned()),
        }
    }

    fn bracket(&mut self) -> Result<Expression, String> {
        if self.take(&['(']).is_none() {
            return Err("a function without its bracket".to_owned());
        }
        let inner = self.sum()?;
        match self.take(&[')']) {
            Some(_) => Ok(inner),
            None => Err("a bracket that is not closed".to_owned()),
        }
    }

    fn number(&mut self) -> Result<Expression, String> {
        let rest = &self.text[self.at..];
        let mut length = 0;
        for (i, c) in rest.char_indices() {
            let after_exponent = matches!(rest[..i].chars().last(), Some('e' | 'E'));
            if !(c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E') || (matches!(c, '+' | '-') && after_exponent)) {
                break;
            }
            length = i + c.len_utf8();
        }
        let word = &rest[..length];
        self.at += length;
        word.parse().map(Expression::Number).map_err(|_| format!("`{word}` is no number"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expressions_have_the_values_of_arithmetic() {
        let value = |text: &str, t: f64| Expression::parse(text).unwrap().value(t);
        assert_eq!(value("1 + 2*t^2", 3.0), 19.0);
        assert_eq!(value("-t^2", 3.0), -9.0);
        assert_eq!(value("2^-1 - 1e-3*(t - 1)/-4", 5.0), 0.501);
        assert_eq!(value("2^3^2", 0.0), 512.0);
        assert_eq!(value("sqrt(t) + abs(-pi)", 4.0), 2.0 + std::f64::consts::PI);
        assert_eq!(value("8/4/2", 0.0), 1.0);
        for wrong in ["", "1 +", "(t", "u", "sin t", "1e", "t t", "1..2", "é", "2**3"] {
            assert!(Expression::parse(wrong).is_err(), "{wrong}");
        }
        assert!(Expression::parse(&"(".repeat(10_000)).is_err());
        assert!(Expression::parse(&"-".repeat(10_000)).is_err());
    }

    #[test]
    fn expressions_print_what_they_mean() {
        let text = "1 - sqrt(t/3)^2*-4";
        let once = Expression::parse(text).unwrap();
        let again = Expression::parse(&once.to_string()).unwrap();
        assert!((once.value(0.7) - again.value(0.7)).abs() < 1e-15);
    }
}
