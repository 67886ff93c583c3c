//! Posts on a rectangular grid: numbers in, a smooth surface through or along them out. Pure; a query reads 16 posts.

/// Numbers at posts, rows of x by ascending z.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct HeightGrid {
    pub columns: usize,
    pub rows: usize,
    pub posts: Vec<f32>,
}

/// A cubic through or along the posts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cubic {
    /// Through the posts, smooth to the first derivative (Catmull & Rom 1974).
    CatmullRom,
    /// Along the posts, smooth to the second derivative: no facets in the light. Lowers peaks a little.
    BSpline,
}

impl HeightGrid {
    pub fn new(columns: usize, rows: usize, post: impl FnMut(usize, usize) -> f32) -> Self {
        let mut post = post;
        let posts = (0..rows).flat_map(|z| (0..columns).map(move |x| (x, z)));
        Self { columns, rows, posts: posts.map(|(x, z)| post(x, z)).collect() }
    }

    pub fn range(&self) -> [f32; 2] {
        let fold = |start, f: fn(f32, f32) -> f32| self.posts.iter().copied().fold(start, f);
        [fold(f32::INFINITY, f32::min), fold(f32::NEG_INFINITY, f32::max)]
    }

    /// Value and its derivatives by x and z per post, at `x` posts from the first column and `z` posts from the first
    /// row; clamped to the grid.
    pub fn with_slope(&self, x: f32, z: f32, cubic: Cubic) -> [f32; 3] {
        let (ix, fx) = split(x, self.columns);
        let (iz, fz) = split(z, self.rows);
        let (wx, dx) = weights(fx, cubic);
        let (wz, dz) = weights(fz, cubic);
        let column = [0, 1, 2, 3].map(|k| (ix + k).saturating_sub(1).min(self.columns - 1));
        let mut found = [0.0; 3];
        for k in 0..4 {
            let row = (iz + k).saturating_sub(1).min(self.rows - 1) * self.columns;
            let p = column.map(|c| self.posts[row + c]);
            let value = p[0] * wx[0] + p[1] * wx[1] + p[2] * wx[2] + p[3] * wx[3];
            let slope = p[0] * dx[0] + p[1] * dx[1] + p[2] * dx[2] + p[3] * dx[3];
            found[0] += value * wz[k];
            found[1] += slope * wz[k];
            found[2] += value * dz[k];
        }
        found
    }

    /// Between four posts, straight; clamped to the grid.
    pub fn bilinear(&self, x: f32, z: f32) -> f32 {
        let (ix, fx) = split(x, self.columns);
        let (iz, fz) = split(z, self.rows);
        let (right, below) = ((ix + 1).min(self.columns - 1), (iz + 1).min(self.rows - 1));
        let row = |z: usize| {
            let (a, b) = (self.posts[z * self.columns + ix], self.posts[z * self.columns + right]);
            a + (b - a) * fx
        };
        let (a, b) = (row(iz), row(below));
        a + (b - a) * fz
    }
}

fn split(at: f32, posts: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (posts - 1) as f32);
    let i = (at as usize).min(posts.saturating_sub(2));
    (i, at - i as f32)
}

fn weights(f: f32, cubic: Cubic) -> ([f32; 4], [f32; 4]) {
    let (f2, f3) = (f * f, f * f * f);
    match cubic {
        Cubic::CatmullRom => (
            [
                0.5 * (-f + 2.0 * f2 - f3),
                0.5 * (2.0 - 5.0 * f2 + 3.0 * f3),
                0.5 * (f + 4.0 * f2 - 3.0 * f3),
                0.5 * (f3 - f2),
            ],
            [
                0.5 * (-1.0 + 4.0 * f - 3.0 * f2),
                0.5 * (-10.0 * f + 9.0 * f2),
                0.5 * (1.0 + 8.0 * f - 9.0 * f2),
                0.5 * (3.0 * f2 - 2.0 * f),
            ],
        ),
        Cubic::BSpline => {
            let g = 1.0 - f;
            (
                [
                    g * g * g / 6.0,
                    (4.0 - 6.0 * f2 + 3.0 * f3) / 6.0,
                    (1.0 + 3.0 * f + 3.0 * f2 - 3.0 * f3) / 6.0,
                    f3 / 6.0,
                ],
                [
                    -0.5 * g * g,
                    (3.0 * f2 - 4.0 * f) * 0.5,
                    (1.0 + 2.0 * f - 3.0 * f2) * 0.5,
                    0.5 * f2,
                ],
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_cubics_follow_a_plane_and_one_meets_every_post() {
        let plane = HeightGrid::new(9, 7, |x, z| 3.0 * x as f32 - 2.0 * z as f32);
        for cubic in [Cubic::CatmullRom, Cubic::BSpline] {
            let [value, dx, dz] = plane.with_slope(3.3, 2.8, cubic);
            assert!((value - (9.9 - 5.6)).abs() < 1e-4, "{cubic:?}: {value}");
            assert!((dx - 3.0).abs() < 1e-4 && (dz + 2.0).abs() < 1e-4, "{cubic:?}: {dx} {dz}");
        }
        let rough = HeightGrid::new(8, 8, |x, z| ((x * 7 + z * 13) % 5) as f32);
        for (i, post) in rough.posts.iter().enumerate() {
            let value = rough.with_slope((i % 8) as f32, (i / 8) as f32, Cubic::CatmullRom)[0];
            assert!((value - post).abs() < 1e-5, "post {i}: {value} for {post}");
        }
        assert_eq!(rough.bilinear(f32::MAX, -5.0), rough.posts[7]);
    }
}
