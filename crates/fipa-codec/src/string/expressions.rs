use fipa_acl::Expression;

use super::reader::{Reader, Span};
use super::scan::is_number;
use crate::DecodeError;

impl Reader<'_> {
    /// Expression of SC00070I.
    #[inline]
    pub(super) fn expression(&mut self) -> Result<Expression, DecodeError> {
        match self.next()? {
            b'(' => self.list(1),
            b'"' | b'#' => self.string(),
            _ => {
                let word = self.word()?;
                Ok(self.word_or_number(word))
            }
        }
    }

    /// Parentheses hold no parameters: words in them end at white space only.
    fn list(&mut self, depth: usize) -> Result<Expression, DecodeError> {
        self.check_depth(depth)?;
        self.step();
        let mut items = Vec::new();
        while !self.closes()? {
            self.count_item()?;
            items.push(match self.next()? {
                b'(' => self.list(depth + 1)?,
                b'"' | b'#' => self.string()?,
                _ => {
                    let word = self.spaced_word()?;
                    self.word_or_number(word)
                }
            });
        }
        Ok(Expression::List(items))
    }

    fn string(&mut self) -> Result<Expression, DecodeError> {
        let span = self.text()?;
        Ok(Expression::String(self.text_of(span)))
    }

    /// A date, and what begins like a number and is none, is kept as a word.
    fn word_or_number(&self, span: Span) -> Expression {
        let is_number = is_number(self.raw(&span));
        let text = self.text_of(span);
        if is_number {
            Expression::Number(text)
        } else {
            Expression::Word(text)
        }
    }
}
