use bytes::Bytes;
use fipa_acl::{Expression, Text};

use super::reader::{Reader, Span};
use super::values::read_number;
use crate::DecodeError;

/// What a code announces.
#[derive(Clone, Copy)]
enum Token {
    Number,
    Text(Form),
}

/// How a text stands there.
#[derive(Clone, Copy)]
enum Form {
    Word,
    Literal,
    Len8,
    Len16,
    Len32,
    Coded,
}

impl Token {
    /// The codes of a token that stands alone.
    fn alone(code: u8) -> Option<Token> {
        Some(match code {
            0x10 => Token::Text(Form::Word),
            0x12 | 0x13 => Token::Number,
            0x14 => Token::Text(Form::Literal),
            0x16 => Token::Text(Form::Len8),
            0x17 => Token::Text(Form::Len16),
            0x19 => Token::Text(Form::Len32),
            0x11 | 0x15 | 0x18 => Token::Text(Form::Coded),
            _ => return None,
        })
    }

    /// The token in the same code as a parenthesis; 8 and 9 have other meanings than alone.
    fn fused(code: u8) -> Option<Token> {
        if !matches!(code, 0x50..=0x59 | 0x70..=0x79) {
            return None;
        }
        Some(match code & 15 {
            0 => Token::Text(Form::Word),
            2 | 3 => Token::Number,
            4 => Token::Text(Form::Literal),
            6 => Token::Text(Form::Len8),
            7 => Token::Text(Form::Len16),
            8 => Token::Text(Form::Len32),
            _ => Token::Text(Form::Coded),
        })
    }
}

impl Reader<'_> {
    /// BinExpression of SC00069G.
    #[inline]
    pub(super) fn expression(&mut self) -> Result<Expression, DecodeError> {
        let mut code = self.octet()?;
        if code == 0xff {
            code = self.octet()?;
        }
        if let Some(token) = Token::alone(code) {
            return self.token(token);
        }
        if !opens(code) {
            return Err(self.unexpected("no expression begins like this"));
        }
        let (list, close) = self.list(code, 1)?;
        match Token::fused(close) {
            None => Ok(list),
            Some(token) => {
                let behind = self.token(token)?;
                Ok(side_by_side(list, behind))
            }
        }
    }

    /// BinString of SC00069G, or what older encoders put in its place.
    pub(super) fn string(&mut self) -> Result<Bytes, DecodeError> {
        let mut code = self.octet()?;
        if code == 0xff {
            code = self.octet()?;
        }
        if let Some(Token::Text(form)) = Token::alone(code) {
            let span = self.span(form)?;
            return Ok(self.bytes_of(span));
        }
        self.go_to(self.position() - 1);
        Ok(Bytes::from(self.expression()?.to_string()))
    }

    /// BinWord of SC00069G.
    #[inline]
    pub(super) fn bin_word(&mut self) -> Result<Text, DecodeError> {
        let form = match self.octet()? {
            0x10 => Form::Word,
            0x11 => Form::Coded,
            _ => return Err(self.unexpected("a word is missing")),
        };
        let span = self.span(form)?;
        Ok(self.text_of(span))
    }

    #[inline]
    fn token(&mut self, token: Token) -> Result<Expression, DecodeError> {
        let form = match token {
            Token::Number => return read_number(self).map(Expression::Number),
            Token::Text(form) => form,
        };
        let span = self.span(form)?;
        let text = self.text_of(span);
        Ok(match form {
            Form::Word => Expression::Word(text),
            _ => Expression::String(text),
        })
    }

    /// All words and strings come in here: where a code table would learn them.
    #[inline]
    fn span(&mut self, form: Form) -> Result<Span, DecodeError> {
        match form {
            Form::Word => self.word(),
            Form::Literal => self.literal(),
            Form::Len8 => self.len8().and_then(|count| self.counted(count)),
            Form::Len16 => self.len16().and_then(|count| self.counted(count)),
            Form::Len32 => self.len32().and_then(|count| self.counted(count)),
            Form::Coded => self.coded(),
        }
    }

    /// A list behind the code that opened it, and the code that closed it.
    fn list(&mut self, open: u8, depth: usize) -> Result<(Expression, u8), DecodeError> {
        self.check_depth(depth)?;
        let mut items = Vec::new();
        let mut announced = Token::fused(open);
        loop {
            if let Some(token) = announced {
                self.count_item()?;
                items.push(self.token(token)?);
            }
            let code = self.octet()?;
            announced = Token::alone(code);
            if announced.is_some() {
                continue;
            }
            if closes(code) {
                return Ok((Expression::List(items), code));
            }
            if !opens(code) {
                return Err(self.unexpected("no expression begins like this"));
            }
            self.count_item()?;
            let (inner, close) = self.list(code, depth + 1)?;
            items.push(inner);
            announced = Token::fused(close);
        }
    }
}

fn opens(code: u8) -> bool {
    matches!(code, 0x60 | 0x70..=0x79)
}

fn closes(code: u8) -> bool {
    matches!(code, 0x40 | 0x50..=0x59)
}

/// A token behind the outermost parenthesis has no place in an expression; it is kept as text.
fn side_by_side(list: Expression, behind: Expression) -> Expression {
    let both = Expression::List(vec![list, behind]).to_string();
    let inner = both.strip_prefix('(').and_then(|t| t.strip_suffix(')'));
    Expression::String(Text::from(inner.unwrap_or(&both)))
}
