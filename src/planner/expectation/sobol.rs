//! Scrambled Sobol points: a digital net in base 2 with a random nested scramble.
//!
//! Direction numbers: Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections" (2008), the
//! first six dimensions. Scramble: Owen's nested uniform scramble by hashing, in the form of Laine and Karras (2011)
//! with Vegdahl's constants. Dimensions beyond six come in pairs of the first two, each pair with a scramble and an
//! order of its own (Burley, "Practical hash-based Owen scrambling", 2020): stratified within a pair, independent
//! between pairs.

/// Dimensions that form one net.
pub const NET_DIMENSIONS: usize = 6;

const BITS: usize = 32;

/// Direction numbers of the net's dimensions, most significant bit first.
const DIRECTIONS: [[u32; BITS]; NET_DIMENSIONS] = directions();

/// Degree, coefficients and initial numbers of the primitive polynomials of dimensions 2 to 6.
const POLYNOMIALS: [(usize, u32, [u32; 4]); NET_DIMENSIONS - 1] = [
    (1, 0, [1, 0, 0, 0]),
    (2, 1, [1, 3, 0, 0]),
    (3, 1, [1, 3, 1, 0]),
    (3, 2, [1, 1, 1, 0]),
    (4, 1, [1, 1, 3, 3]),
];

const fn directions() -> [[u32; BITS]; NET_DIMENSIONS] {
    let mut all = [[0u32; BITS]; NET_DIMENSIONS];
    let mut bit = 0;
    while bit < BITS {
        all[0][bit] = 1 << (BITS - 1 - bit);
        bit += 1;
    }
    let mut dimension = 1;
    while dimension < NET_DIMENSIONS {
        let (degree, coefficients, initial) = POLYNOMIALS[dimension - 1];
        let mut k = 0;
        while k < BITS {
            all[dimension][k] = if k < degree {
                initial[k] << (BITS - 1 - k)
            } else {
                let mut v = all[dimension][k - degree] ^ (all[dimension][k - degree] >> degree);
                let mut term = 1;
                while term < degree {
                    if (coefficients >> (degree - 1 - term)) & 1 == 1 {
                        v ^= all[dimension][k - term];
                    }
                    term += 1;
                }
                v
            };
            k += 1;
        }
        dimension += 1;
    }
    all
}

/// The unscrambled point `index` in `dimension` (below [`NET_DIMENSIONS`]), as a 32-bit fraction.
#[must_use]
#[inline(always)]
fn sobol(index: u32, dimension: usize) -> u32 {
    let mut rest = index;
    let mut x = 0;
    for v in &DIRECTIONS[dimension] {
        if rest == 0 {
            break;
        }
        if rest & 1 == 1 {
            x ^= v;
        }
        rest >>= 1;
    }
    x
}

/// The unscrambled point `index` in one of the first two dimensions: the bits of the index reversed, and their product with
/// Pascal's triangle modulo 2, which is one of five factors.
#[must_use]
#[inline(always)]
fn sobol_pair(index: u32, second: bool) -> u32 {
    let mut x = index.reverse_bits();
    if second {
        x ^= x << 16;
        x ^= (x & 0x00ff_00ff) << 8;
        x ^= (x & 0x0f0f_0f0f) << 4;
        x ^= (x & 0x3333_3333) << 2;
        x ^= (x & 0x5555_5555) << 1;
    }
    x
}

/// The middle of a cell of the finest resolution: never 0 nor 1.
#[inline(always)]
fn middle(bits: u32) -> f64 {
    (f64::from(bits) + 0.5) / (1u64 << BITS) as f64
}

/// A nested uniform scramble of the bits of `x`, most significant first.
#[inline(always)]
fn nested_scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// A well-mixed word of two (splitmix64's finaliser).
#[must_use]
pub fn mix(seed: u64, stream: u64) -> u64 {
    let mut z = seed.wrapping_add(stream.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// One scrambled point set. Any number of points; powers of two are best.
#[derive(Debug, Clone, Copy)]
pub struct Scrambled {
    seed: u64,
}

impl Scrambled {
    /// The set of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// Coordinate `dimension` of point `index`, strictly inside (0, 1).
    ///
    /// Dimensions 0 to 5 are one net; from 6 on, (6, 7), (8, 9), ... are nets of two.
    #[must_use]
    pub fn coordinate(&self, index: u32, dimension: usize) -> f64 {
        let [value] = self.coordinates(index, dimension);
        value
    }

    /// Coordinate `dimension` of the points from `first` on, which is a multiple of their number, a power of two.
    #[must_use]
    #[inline(always)]
    pub fn coordinates<const COUNT: usize>(&self, first: u32, dimension: usize) -> [f64; COUNT] {
        let scramble = mix(self.seed, dimension as u64);
        let scramble = scramble as u32 ^ (scramble >> 32) as u32;
        let mut bits = [0; COUNT];
        if dimension < NET_DIMENSIONS {
            // A point of the net is the exclusive or of those of its index's bits.
            let base = sobol(first, dimension);
            for (l, b) in bits.iter_mut().enumerate() {
                *b = base ^ sobol(l as u32, dimension);
            }
        } else {
            let pair = mix(self.seed, (1 << 32) + (dimension / 2) as u64) as u32;
            for (l, b) in bits.iter_mut().enumerate() {
                // A nested scramble of the index maps every aligned power-of-two block of points onto another.
                *b = sobol_pair(nested_scramble(first + l as u32, pair), dimension % 2 == 1);
            }
        }
        let mut out = [0.0; COUNT];
        for (x, b) in out.iter_mut().zip(bits) {
            *x = middle(nested_scramble(b, scramble));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_first_points_of_the_sequence() {
        // Published first points, dimensions 1 to 3 (in the binary, not the Gray-code order).
        let expected = [
            [0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5],
            [0.25, 0.75, 0.75],
            [0.75, 0.25, 0.25],
            [0.125, 0.625, 0.375],
            [0.625, 0.125, 0.875],
            [0.375, 0.375, 0.625],
            [0.875, 0.875, 0.125],
        ];
        for (index, point) in expected.iter().enumerate() {
            for (dimension, x) in point.iter().enumerate() {
                assert_eq!(
                    f64::from(sobol(index as u32, dimension)) / 32f64.exp2(),
                    *x,
                    "{index} {dimension}"
                );
            }
        }
    }

    #[test]
    fn val_both_roads_to_the_first_two_dimensions_are_one() {
        for index in (0..4096).chain((0..32).map(|bit| u32::MAX >> bit)) {
            let pair = [false, true].map(|second| sobol_pair(index, second));
            assert_eq!(pair, [0, 1].map(|dimension: usize| sobol(index, dimension)), "{index}");
        }
    }

    #[test]
    fn val_points_in_one_go_are_the_points_one_by_one() {
        let set = Scrambled::new(11);
        for dimension in 0..NET_DIMENSIONS + 4 {
            for first in [0, 8, 2040] {
                let all: [f64; 8] = set.coordinates(first, dimension);
                let one_by_one = [0, 1, 2, 3, 4, 5, 6, 7].map(|l: u32| set.coordinate(first + l, dimension));
                assert_eq!(all, one_by_one);
            }
        }
    }

    #[test]
    fn prop_every_coordinate_is_stratified() {
        let set = Scrambled::new(11);
        for dimension in 0..12 {
            let mut seen = [false; 1024];
            for index in 0..1024 {
                seen[(set.coordinate(index, dimension) * 1024.0) as usize] = true;
            }
            assert!(seen.iter().all(|s| *s), "dimension {dimension}");
        }
    }

    #[test]
    fn prop_pairs_are_nets() {
        // Any elementary interval of volume 2^-8 in a pair holds one of 256 points.
        let set = Scrambled::new(5);
        for (a, b) in [(0, 1), (6, 7), (20, 21)] {
            for split in 0..=8 {
                let (columns, rows) = (1usize << split, 256 >> split);
                let mut seen = vec![false; 256];
                for index in 0..256 {
                    let (x, y) = (set.coordinate(index, a), set.coordinate(index, b));
                    seen[(x * columns as f64) as usize * rows + (y * rows as f64) as usize] = true;
                }
                assert!(seen.iter().all(|s| *s), "({a}, {b}) split {split}");
            }
        }
    }

    #[test]
    fn prop_pairs_are_uncorrelated_with_each_other() {
        let n = 4096;
        let correlation = |x: &dyn Fn(u32) -> f64, y: &dyn Fn(u32) -> f64| {
            12.0 * (0..n).map(|i| (x(i) - 0.5) * (y(i) - 0.5)).sum::<f64>() / f64::from(n)
        };
        let a = Scrambled::new(1);
        // Four standard errors of independent uniforms.
        let limit = 4.0 / f64::from(n).sqrt();
        for (d, e) in [(0, 6), (6, 8), (7, 9), (10, 21)] {
            assert!(correlation(&|i| a.coordinate(i, d), &|i| a.coordinate(i, e)).abs() < limit);
        }
    }
}
