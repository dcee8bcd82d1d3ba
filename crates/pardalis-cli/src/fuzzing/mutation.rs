//! Damage to files: bits, numbers, words, lines and pieces of other files.

/// Numbers at which readers may stumble.
const NUMBERS: [&str; 16] = [
    "0",
    "-0",
    "-1",
    "1",
    "2",
    "0.5",
    "255",
    "65536",
    "4294967295",
    "18446744073709551616",
    "1e308",
    "-1e308",
    "1e-320",
    "1e999",
    "nan",
    "inf",
];

/// Characters with a meaning in some format.
const PUNCTUATION: &[u8] = b"0123456789-+.eE:[]{}<>/\"'#&*!|%=,; \t\r\n\0\xFF\x80";

/// A stream of random numbers, the same on every computer: SplitMix64.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns a number below `bound`, which must not be 0.
    pub(super) fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ mixed >> 31) % bound as u64) as usize
    }

    fn of<'a, T: ?Sized>(&mut self, choices: &[&'a T]) -> &'a T {
        choices[self.below(choices.len())]
    }
}

/// Samples of one kind of file.
pub(super) struct Samples {
    pub(super) files: Vec<Vec<u8>>,
    /// The words in all files.
    words: Vec<Vec<u8>>,
}

impl Samples {
    pub(super) fn new(files: Vec<Vec<u8>>) -> Self {
        let is_outside = |byte: &u8| !is_word(*byte);
        let words = files.iter().flat_map(|file| file.split(is_outside));
        let mut words: Vec<_> = words
            .filter(|word| word.len() > 1)
            .map(<[u8]>::to_vec)
            .collect();
        words.sort();
        words.dedup();
        Self { files, words }
    }

    /// Returns one of the files, damaged in one to three places.
    pub(super) fn damaged(&self, random: &mut Random) -> Vec<u8> {
        let mut bytes = self.files[random.below(self.files.len())].clone();
        for _ in 0..=random.below(3) {
            if bytes.is_empty() {
                break;
            }
            self.damage(&mut bytes, random);
        }
        bytes
    }

    fn damage(&self, bytes: &mut Vec<u8>, random: &mut Random) {
        let at = random.below(bytes.len());
        let end = (at + 1 + random.below(20)).min(bytes.len());
        match random.below(10) {
            0 | 1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at] = PUNCTUATION[random.below(PUNCTUATION.len())],
            3 => drop(bytes.drain(at..end)),
            4 => {
                let to = random.below(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(to..to, piece);
            }
            5 => {
                let is_number = |byte: u8| byte.is_ascii_digit() || b".+-eE".contains(&byte);
                let number = run_at(bytes, at, u8::is_ascii_digit, is_number);
                bytes.splice(number, random.of(&NUMBERS).bytes());
            }
            6 if !self.words.is_empty() => {
                let word = run_at(bytes, at, |byte| is_word(*byte), is_word);
                let other = &self.words[random.below(self.words.len())];
                bytes.splice(word, other.iter().copied());
            }
            7 => {
                let other = &self.files[random.below(self.files.len())];
                let from = random.below(other.len());
                let to = (from + 1 + random.below(200)).min(other.len());
                bytes.splice(at..end, other[from..to].iter().copied());
            }
            8 => {
                let is_end = |byte: &u8| *byte == b'\n';
                let start = bytes[..at]
                    .iter()
                    .rposition(is_end)
                    .map_or(0, |end| end + 1);
                let end = bytes[at..]
                    .iter()
                    .position(is_end)
                    .map_or(bytes.len(), |end| at + end + 1);
                let line = bytes[start..end].to_vec();
                match random.below(2) {
                    0 => drop(bytes.drain(start..end)),
                    _ => drop(bytes.splice(start..start, line)),
                }
            }
            // The bytes of a binary number.
            _ => {
                let end = (at + (1 << random.below(4))).min(bytes.len());
                bytes[at..end].fill([0, 1, 0x7F, 0x80, 0xFF][random.below(5)]);
            }
        }
    }
}

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Returns the place of the first run of bytes after `at` that begins with one byte and continues with others; the end if there
/// is none.
fn run_at(
    bytes: &[u8],
    at: usize,
    begins: impl Fn(&u8) -> bool,
    continues: impl Fn(u8) -> bool,
) -> std::ops::Range<usize> {
    let start = bytes[at..]
        .iter()
        .position(begins)
        .map_or(bytes.len(), |start| at + start);
    let length = bytes[start..].iter().position(|&byte| !continues(byte));
    start..length.map_or(bytes.len(), |length| start + length)
}
