use bytes::Bytes;
use fipa_acl::{Expression, Text};

use super::numbers::read_number;
use super::reader::Reader;
use super::texts::Form;
use crate::DecodeError;

/// What a code announces.
#[derive(Clone, Copy)]
enum Token {
    Number,
    Text(Form),
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
    /// BinExpression of SC00069G, into its place.
    #[inline(always)]
    pub(super) fn expression_to(
        &mut self,
        place: &mut Option<Expression>,
    ) -> Result<(), DecodeError> {
        *place = None;
        match self.octet()? {
            0x10 => {
                let found = self.find(Form::Word)?;
                self.take_with(found, |text| *place = Some(Expression::Word(text)));
            }
            0x14 => {
                let found = self.find(Form::Literal)?;
                self.take_with(found, |text| *place = Some(Expression::String(text)));
            }
            code => *place = Some(self.expression_behind(code)?),
        }
        Ok(())
    }

    /// BinExpression of SC00069G.
    pub(super) fn expression(&mut self) -> Result<Expression, DecodeError> {
        let code = self.octet()?;
        self.expression_behind(code)
    }

    #[inline(never)]
    fn expression_behind(&mut self, mut code: u8) -> Result<Expression, DecodeError> {
        if code == 0xff {
            code = self.octet()?;
        }
        if let Some(token) = Token::alone(code) {
            return self.token(token, code);
        }
        if !opens(code) {
            return Err(self.unexpected("no expression begins like this"));
        }
        let (list, close) = self.list(code, 1)?;
        match Token::fused(close) {
            None => Ok(list),
            Some(token) => {
                let behind = self.token(token, close)?;
                Ok(side_by_side(list, behind))
            }
        }
    }

    /// The content: a BinString of SC00069G, or what older encoders put in its place. It never
    /// enters a code table, neither as a whole nor piecewise.
    pub(super) fn content(&mut self) -> Result<Bytes, DecodeError> {
        if self.table.is_some() && matches!(self.peek()?, 0x15 | 0x18) {
            self.octet()?;
            let found = self.find_coded()?;
            return Ok(self.take_octets(found));
        }
        // An encoder that puts contents into its table has other numbers in it than we have.
        let coding = self.table.take();
        let content = self.string();
        self.table = coding;
        content
    }

    /// BinString of SC00069G, or what older encoders put in its place.
    pub(super) fn string(&mut self) -> Result<Bytes, DecodeError> {
        let mut code = self.octet()?;
        if code == 0xff {
            code = self.octet()?;
        }
        if let Some(Token::Text(form)) = Token::alone(code) {
            let found = self.find_here(form)?;
            return Ok(self.take_octets(found));
        }
        Ok(Bytes::from(self.expression_behind(code)?.to_string()))
    }

    fn token(&mut self, token: Token, code: u8) -> Result<Expression, DecodeError> {
        let form = match token {
            Token::Number => return read_number(self).map(Expression::Number),
            Token::Text(form) => form,
        };
        let found = self.find(form)?;
        let text = self.take(found);
        Ok(match code & 15 {
            0 | 1 => Expression::Word(text),
            _ => Expression::String(text),
        })
    }

    /// A list behind the code that opened it, and the code that closed it.
    fn list(&mut self, open: u8, depth: usize) -> Result<(Expression, u8), DecodeError> {
        self.check_depth(depth)?;
        let mut items = Vec::new();
        let mut code = open;
        let mut announced = Token::fused(open);
        loop {
            if let Some(token) = announced {
                self.count_item()?;
                items.push(self.token(token, code)?);
            }
            code = self.octet()?;
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
            code = close;
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
