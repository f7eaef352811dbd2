//! The view and what steers it. What it shows is drawn by `assets/viewer/`.

use std::fmt::Write as _;

use ::base64::Engine as _;
use ::base64::engine::general_purpose::STANDARD;

use super::Report;
use super::answer::length;

/// Buttons, canvas, legend, keys, and the picture that stands in for them.
pub(super) fn view(report: &Report<'_>) -> String {
    let scene = report.scene;
    let mut out =
        String::from("<div class=\"tools\" role=\"toolbar\" aria-label=\"What is shown\">");
    if scene.has_places() {
        out += &group(
            "Before or after",
            &[
                ("data-when=\"before\"", "Before", "B: as the query came"),
                ("data-when=\"after\"", "After", "B: where it was put"),
            ],
        );
        let mut colours = vec![("data-colour=\"plain\"", "Plain", "G: the query green")];
        if scene.reach().is_some() {
            let residuals = (
                "data-colour=\"residuals\"",
                "Residuals",
                "R: how far off the map each point lies",
            );
            colours.insert(0, residuals);
        }
        if scene.has_patches() {
            colours.push((
                "data-colour=\"patches\"",
                "Rock",
                "P: what each patch of wall says",
            ));
        }
        out += &group("Colours", &colours);
    }
    out += &looks();
    out += "</div>";
    out += &stage(&before(scene.moved()));
    out += "<div class=\"tools more\" role=\"toolbar\" aria-label=\"How it is shown\">";
    out += CUT;
    if let Some(e) = scene.ellipsoid() {
        let factors = [1, 10, 100, 1000].map(|f| format!("<option value=\"{f}\">×{f}</option>"));
        let _ = write!(
            out,
            "<label>95 % ellipsoid{} (± {})<select id=\"factor\">{}</select></label>",
            if scene.is_guess() {
                " of place 1, a guess"
            } else {
                ""
            },
            length(e.half[2]),
            factors.concat()
        );
    }
    out += "</div>";
    out += &legend(report);
    out += "<p class=\"keys\"><kbd>Tab</kbd> to the view, then <kbd>←</kbd><kbd>→</kbd><kbd>↑</kbd><kbd>↓</kbd> turn, with <kbd>Shift</kbd> move, <kbd>+</kbd><kbd>−</kbd> zoom · \
            <kbd>1</kbd>–<kbd>9</kbd> place · <kbd>B</kbd> before or after · <kbd>R</kbd> residuals · <kbd>G</kbd> plain · <kbd>P</kbd> rock · \
            <kbd>Q</kbd> query · <kbd>W</kbd> whole map · <kbd>A</kbd> from above · <kbd>[</kbd><kbd>]</kbd> roof · <kbd>M</kbd> map on or off</p>";
    let _ = write!(
        out,
        "<figure class=\"picture\" style=\"margin:0\"><p class=\"faint\">A flat picture: this browser shows no three-dimensional view (it needs scripts and WebGL).</p>\
         <img alt=\"The map in magenta and the query in green, before and after\" src=\"data:image/png;base64,{}\"></figure>",
        STANDARD.encode(report.png)
    );
    out
}

/// The canvas and what lies over it; `before` is said of the query as it came.
pub(crate) fn stage(before: &str) -> String {
    let mut out = String::from(
        "<div class=\"stage\"><canvas id=\"view\" tabindex=\"0\" role=\"application\" aria-roledescription=\"three-dimensional view\" aria-label=\"The query in the map. Arrow keys turn it, plus and minus zoom.\"></canvas>\
         <div id=\"layer\">",
    );
    let _ = write!(
        out,
        "<p class=\"note\" data-only=\"before\" hidden>{before}</p><p class=\"note\" data-only=\"unasked\" hidden></p><svg class=\"axes\" viewBox=\"0 0 64 64\" aria-hidden=\"true\">"
    );
    for axis in ["x", "y", "z"] {
        let _ = write!(
            out,
            "<line class=\"{axis}\" x1=\"32\" y1=\"32\" x2=\"32\" y2=\"32\"/><text class=\"{axis}\">{axis}</text>"
        );
    }
    out += "</svg><div class=\"scale\" aria-hidden=\"true\"></div></div></div><p id=\"says\" class=\"skip\" role=\"status\"></p>";
    out
}

/// How much of the roof is taken away.
pub(crate) const CUT: &str = "<label>Cut the roof<input type=\"range\" id=\"cut\" min=\"0\" max=\"100\" value=\"100\" title=\"[ and ]\"><output id=\"cut-says\" for=\"cut\"></output></label>";

fn group(name: &str, buttons: &[(&str, &str, &str)]) -> String {
    let mut out = format!("<div class=\"group\" role=\"group\" aria-label=\"{name}\">");
    for (data, text, title) in buttons {
        let _ = write!(
            out,
            "<button type=\"button\" {data} aria-pressed=\"false\" title=\"{title}\">{text}</button>"
        );
    }
    out + "</div>"
}

pub(crate) fn looks() -> String {
    let looks = [
        ("nearQuery", "Query", "Q: look at the query"),
        ("wholeMap", "Whole map", "W: look at all of the map"),
        ("fromAbove", "From above", "A: look straight down"),
    ];
    let mut out = String::from("<div class=\"group\" role=\"group\" aria-label=\"Look at\">");
    for (look, text, title) in looks {
        let _ = write!(
            out,
            "<button type=\"button\" data-look=\"{look}\" title=\"{title}\">{text}</button>"
        );
    }
    out + "</div>"
}

fn before(moved: f64) -> String {
    if moved > 0.0 {
        format!(
            "Before: the query's own frame lies {:.1} km from the map's, so the query is drawn beside the map.",
            moved / 1000.0
        )
    } else {
        "Before: the query as it came, in its own frame.".into()
    }
}

/// What the colours mean, for each way of colouring.
fn legend(report: &Report<'_>) -> String {
    let swatch = |colour: &str, text: &str| {
        format!("<span><i class=\"swatch\" style=\"background:var(--{colour})\"></i>{text}</span>")
    };
    let map = swatch("map", "map");
    let ghosts = if report.scene.has_ghosts() {
        swatch("ghost", "the query where it could lie as well")
    } else {
        String::new()
    };
    let mut out = format!(
        "<div class=\"legend\"><div class=\"row\" data-legend=\"plain\">{map}{}{ghosts}</div>",
        swatch("query", "query")
    );
    if let Some([fine, most, reach]) = report.scene.reach() {
        let cm = |m: f64| format!("{:.0} cm", 100.0 * m);
        let _ = write!(
            out,
            "<div data-legend=\"residuals\" hidden><div class=\"row\">{map}<span class=\"ramp\">the query lies 0<i></i>{}+ off the map's surface</span>{}{ghosts}</div>\
             <div class=\"parts\" aria-hidden=\"true\"><i data-part=\"fine\"></i><i data-part=\"near\"></i><i data-part=\"off\"></i></div>\
             <div class=\"row\"><span><b data-share=\"fine\"></b> lies finely (within {})</span><span><b data-share=\"near\"></b> does not</span>\
             <span><b data-share=\"off\"></b> has no map within {}</span></div></div>",
            cm(most),
            swatch("off", "no map there"),
            length(fine),
            cm(reach)
        );
    }
    if report.scene.has_patches() {
        let _ = write!(
            out,
            "<div data-legend=\"patches\" hidden><div class=\"row\">{map}{}{}{}{ghosts}</div>\
             <p class=\"faint\">Each disc is a patch of wall, laid on the map where the pose puts it and then moved about: the same rock lies finest unmoved. By chance one in three does.</p></div>",
            swatch("fine", "this patch lies finest right here"),
            swatch("worst", "it lies as well elsewhere"),
            swatch("unasked", "too little map around to ask")
        );
    }
    out + "</div>"
}
