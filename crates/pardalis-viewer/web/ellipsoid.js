// Covariances as ellipsoids.

/**
 * Returns variances and directions of a symmetric 3 x 3 matrix [xx, xy, xz, yy, yz, zz] by Jacobi's rotations: `values` and, as rows, unit `vectors` that form a
 * right-handed frame; null if an entry is missing or a variance is clearly negative.
 */
export function principalAxes([xx, xy, xz, yy, yz, zz]) {
  const a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
  if (!a.flat().every(Number.isFinite)) return null;
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const size = Math.hypot(...a.flat());
  for (let sweep = 0; sweep < 20; sweep++) {
    if (Math.hypot(a[0][1], a[0][2], a[1][2]) <= 1e-12 * size) break;
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (a[p][q] === 0) continue;
      const angle = 0.5 * Math.atan2(2 * a[p][q], a[p][p] - a[q][q]);
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [c * a[k][p] + s * a[k][q], c * a[k][q] - s * a[k][p]];
      for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [c * a[p][k] + s * a[q][k], c * a[q][k] - s * a[p][k]];
      for (let k = 0; k < 3; k++) [v[p][k], v[q][k]] = [c * v[p][k] + s * v[q][k], c * v[q][k] - s * v[p][k]];
    }
  }
  const values = [a[0][0], a[1][1], a[2][2]];
  if (values.some((value) => value < -1e-6 * size)) return null;
  return { values: values.map((value) => Math.max(0, value)), vectors: v };
}
