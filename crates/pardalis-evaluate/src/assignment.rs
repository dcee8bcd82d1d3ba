//! Linear assignment (Hungarian method): rows to columns with the largest total.

/// Assigns each row a different column so that the total of `fit(row, column)` is maximal. Rows in excess of the
/// columns get `None`. Totals must not overflow `i64`. Among equally good assignments, the choice depends only on
/// `fit`.
///
/// Shortest augmenting paths with dual prices: O(r² c) for r rows and c columns, or vice versa (R. Jonker and
/// A. Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems", Computing 38, 1987).
pub(super) fn best_assignment(
    rows: usize,
    columns: usize,
    fit: impl Fn(usize, usize) -> i64,
) -> Vec<Option<usize>> {
    if rows <= columns {
        let row_of = rows_of_columns(rows, columns, |i, j| -fit(i, j));
        inverse(&row_of, rows)
    } else {
        rows_of_columns(columns, rows, |j, i| -fit(i, j))
    }
}

fn inverse(row_of: &[Option<usize>], rows: usize) -> Vec<Option<usize>> {
    let mut column_of = vec![None; rows];
    for (column, row) in row_of.iter().enumerate() {
        if let Some(row) = *row {
            column_of[row] = Some(column);
        }
    }
    column_of
}

/// Returns the row of each column in the cheapest assignment of all rows. There must be at most as many rows as
/// columns.
fn rows_of_columns(
    rows: usize,
    columns: usize,
    cost: impl Fn(usize, usize) -> i64,
) -> Vec<Option<usize>> {
    let mut row_of: Vec<Option<usize>> = vec![None; columns];
    // Prices: cost - row_price - column_price is never negative, and 0 for assigned pairs.
    let (mut row_price, mut column_price) = (vec![0_i64; rows], vec![0_i64; columns]);
    for new_row in 0..rows {
        // Cost of the cheapest augmenting path to each column, and the previous column on it.
        let mut distance = vec![i64::MAX; columns];
        let mut before: Vec<Option<usize>> = vec![None; columns];
        let mut reached = vec![false; columns];
        let (mut row, mut from) = (new_row, None);
        let free = loop {
            let base = from.map_or(0, |column: usize| distance[column]);
            for column in (0..columns).filter(|column| !reached[*column]) {
                let step = cost(row, column) - row_price[row] - column_price[column];
                if base + step < distance[column] {
                    distance[column] = base + step;
                    before[column] = from;
                }
            }
            let unreached = (0..columns).filter(|column| !reached[*column]);
            let nearest = unreached
                .min_by_key(|column| distance[*column])
                .expect("at most as many rows as columns");
            match row_of[nearest] {
                None => break nearest,
                Some(next) => {
                    reached[nearest] = true;
                    (row, from) = (next, Some(nearest));
                }
            }
        };
        row_price[new_row] += distance[free];
        for column in (0..columns).filter(|column| reached[*column]) {
            let saved = distance[free] - distance[column];
            column_price[column] -= saved;
            if let Some(row) = row_of[column] {
                row_price[row] += saved;
            }
        }
        let mut column = free;
        while let Some(previous) = before[column] {
            row_of[column] = row_of[previous];
            column = previous;
        }
        row_of[column] = Some(new_row);
    }
    row_of
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the largest total of all assignments with the maximal number of rows, by exhaustive search.
    fn largest_total(fits: &[Vec<i64>], columns: usize) -> i64 {
        fn best(fits: &[Vec<i64>], free: &mut Vec<usize>, spare_rows: usize) -> i64 {
            let Some((first, rest)) = fits.split_first() else {
                return 0;
            };
            let mut greatest = i64::MIN;
            if spare_rows > 0 {
                greatest = best(rest, free, spare_rows - 1);
            }
            for index in 0..free.len() {
                let column = free.remove(index);
                let total = first[column].saturating_add(best(rest, free, spare_rows));
                greatest = greatest.max(total);
                free.insert(index, column);
            }
            greatest
        }
        let spare_rows = fits.len().saturating_sub(columns);
        best(fits, &mut (0..columns).collect(), spare_rows)
    }

    fn matrices() -> impl Strategy<Value = (usize, Vec<Vec<i64>>)> {
        (0_usize..6, 0_usize..6).prop_flat_map(|(rows, columns)| {
            // Either few different numbers, so that ties are frequent, or many.
            let number = prop_oneof![-3_i64..4, 0_i64..1_000_000_000];
            let row = proptest::collection::vec(number, columns);
            (Just(columns), proptest::collection::vec(row, rows))
        })
    }

    proptest! {
        #[test]
        fn total_is_maximal((columns, fits) in matrices()) {
            let found = best_assignment(fits.len(), columns, |i, j| fits[i][j]);
            prop_assert_eq!(found.len(), fits.len());
            let mut taken: Vec<usize> = found.iter().flatten().copied().collect();
            prop_assert_eq!(taken.len(), fits.len().min(columns));
            taken.sort_unstable();
            taken.dedup();
            prop_assert_eq!(taken.len(), fits.len().min(columns));
            let total: i64 = found.iter().enumerate().filter_map(|(i, j)| Some(fits[i][(*j)?])).sum();
            prop_assert_eq!(total, largest_total(&fits, columns));
        }
    }

    #[test]
    fn rows_yield_for_a_larger_total() {
        let fits = [[9, 8], [8, 1]];
        let found = best_assignment(2, 2, |i, j| fits[i][j]);
        assert_eq!(found, [Some(1), Some(0)]);
        assert_eq!(best_assignment(2, 0, |_, _| 1), [None, None]);
        assert_eq!(best_assignment(0, 2, |_, _| 1), []);
    }
}
