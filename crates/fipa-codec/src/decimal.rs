/// The decimal digits of a number, without anything in front of them.
pub(crate) struct Decimal {
    digits: [u8; 20],
    start: usize,
}

impl Decimal {
    #[inline]
    pub(crate) fn new(mut number: u64) -> Decimal {
        let mut digits = [b'0'; 20];
        let mut start = digits.len();
        for digit in digits.iter_mut().rev() {
            let [ones, ..] = (number % 10).to_le_bytes();
            *digit = b'0' + ones;
            start -= 1;
            number /= 10;
            if number == 0 {
                break;
            }
        }
        Decimal { digits, start }
    }

    /// Those of a count.
    #[inline]
    pub(crate) fn of(count: usize) -> Decimal {
        Decimal::new(u64::try_from(count).unwrap_or(u64::MAX))
    }

    #[inline]
    pub(crate) fn as_bytes(&self) -> &[u8] {
        self.digits.get(self.start..).unwrap_or_default()
    }
}
