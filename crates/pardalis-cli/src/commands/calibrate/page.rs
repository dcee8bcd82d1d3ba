//! The calibration report as a self-contained HTML page.

use std::fmt::Write as _;

use anyhow::Result;

use super::report::Report;
use crate::draw::calibration::{
    coverage, observed_and_projected, residual_arrows, residual_scatter, rms_bars,
};

const STYLE: &str = "body{font:16px/1.45 'DejaVu Sans',sans-serif;color:#282828;max-width:62em;margin:2em auto;padding:0 1em}\
    table{border-collapse:collapse;margin:1em 0;font-size:14px;display:block;overflow-x:auto}\
    td,th{padding:.25em .8em;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap}\
    td:first-child,th:first-child{text-align:left}figure{margin:1.5em 0}svg{max-width:100%;height:auto}";

/// Renders the page.
pub(super) fn page(report: &Report) -> Result<String> {
    let best = report.best();
    let observed_points = report.all_observed_points(best);
    let size_px = report.size_px;
    let mut page = begin(&report.title());
    push_table(&mut page, &report.comparison());
    for (name, reason) in &report.fits.failed {
        push_paragraph(&mut page, &format!("{name}: {reason}"));
    }
    push_paragraph(&mut page, &report.coverage());
    if let Some(end) = report.end() {
        push_paragraph(&mut page, &end);
    }
    for warning in report.warnings() {
        push_paragraph(&mut page, &format!("Warning: {warning}"));
    }
    if let Some(pose) = report.pose() {
        push_paragraph(&mut page, &pose);
    }
    let _ = writeln!(
        page,
        "<h2>{}: observed and projected points</h2>",
        best.camera.kind()
    );
    for picture in [
        observed_and_projected(size_px, &observed_points)?,
        residual_arrows(size_px, &observed_points)?,
        residual_scatter(&observed_points, best.rms_px)?,
        coverage(size_px, &observed_points)?,
    ] {
        let _ = writeln!(page, "<figure>{}</figure>", picture.svg);
    }
    page.push_str("<h2>Views</h2>\n");
    push_table(&mut page, &report.view_rows());
    let views: Vec<(&str, f64)> = best.views.iter().map(|v| (&*v.name, v.rms_px)).collect();
    if views.len() > 1 {
        let _ = writeln!(
            page,
            "<figure>{}</figure>",
            rms_bars(&views, best.rms_px)?.svg
        );
    }
    let outliers = report.outliers();
    if !outliers.is_empty() {
        page.push_str("<h2>Outliers</h2>\n");
        for outlier in outliers {
            push_paragraph(&mut page, &outlier);
        }
    }
    if !report.images.is_empty() {
        page.push_str("<h2>Images</h2>\n");
        let head = vec!["image".to_owned(), "found".to_owned()];
        let images = report.image_rows().into_iter().map(|row| row.to_vec());
        let rows: Vec<Vec<String>> = std::iter::once(head).chain(images).collect();
        push_table(&mut page, &rows);
    }
    page.push_str("</body></html>\n");
    Ok(page)
}

/// Begins a page; `</body></html>` ends it.
pub(super) fn begin(title: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\"><title>{title}</title>\
         <style>{STYLE}</style></head><body>\n<h1>Calibration</h1>\n<p>{title}.</p>\n"
    )
}

/// Appends a table whose first row is the header.
pub(super) fn push_table(page: &mut String, rows: &[Vec<String>]) {
    page.push_str("<table>\n");
    for (number, row) in rows.iter().enumerate() {
        let cell = if number == 0 { "th" } else { "td" };
        page.push_str("<tr>");
        for text in row {
            let _ = write!(page, "<{cell}>{}</{cell}>", escaped(text));
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</table>\n");
}

pub(super) fn push_paragraph(page: &mut String, text: &str) {
    let _ = writeln!(page, "<p>{}</p>", escaped(text));
}

/// Escapes characters with a meaning in HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
