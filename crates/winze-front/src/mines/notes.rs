//! What a user must know of a mesh that was read from a file.

use winze_sim::mesh_file::MeshReport;

/// Notes on the mesh of a mine, a sentence each.
pub(super) fn of(mine: &str, read: &MeshReport) -> Vec<String> {
    let mut notes = Vec::new();
    if read.origin != [0.0; 3] {
        let [x, y, z] = read.origin;
        notes.push(format!(
            "mine \"{mine}\": its mesh lies far from the origin and was moved: lines, places and the map are \
             in coordinates less {x:.0}, {y:.0}, {z:.0} (set the map's origin to that to get the file's again)"
        ));
    }
    let left = &read.left_out;
    if left.broken + left.degenerate > 0 {
        notes.push(format!(
            "mine \"{mine}\": of its triangles {} have a corner that is not finite or missing and {} have no area; \
             they were left out, {} are used",
            left.broken, left.degenerate, read.triangles
        ));
    }
    notes
}
