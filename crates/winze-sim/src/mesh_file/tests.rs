use super::*;

const SQUARE: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.5],
    [1.0, 1.0, 0.25],
    [0.0, 1.0, -0.125],
];

fn ply(header: &str, body: &[u8]) -> Vec<u8> {
    let mut out = format!("ply\n{header}end_header\n").into_bytes();
    out.extend_from_slice(body);
    out
}

const ASCII: &str = "format ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                     element face 1\nproperty list uchar int vertex_indices\n";

/// The square by every reader and encoding, as one polygon or two triangles.
fn squares() -> Vec<(&'static str, Vec<u8>, MeshFormat)> {
    let binary = |little: bool, fixed: bool| {
        let order = if little { "little" } else { "big" };
        let corners = if fixed {
            "element face 2\nproperty uint v1\nproperty uint v2\nproperty uint v3\n"
        } else {
            "element face 1\nproperty float quality\nproperty list ushort uint vertex_index\n"
        };
        let header = format!(
            "format binary_{order}_endian 1.0\ncomment a square\nelement camera 1\nproperty list uchar short a\n\
             element vertex 4\nproperty float x\nproperty uchar red\nproperty float y\nproperty float z\n{corners}"
        );
        let f = |v: f32| {
            if little {
                v.to_le_bytes()
            } else {
                v.to_be_bytes()
            }
        };
        let u = |v: u32| {
            if little {
                v.to_le_bytes()
            } else {
                v.to_be_bytes()
            }
        };
        let mut body = vec![2, 0, 1, 0, 2];
        for v in SQUARE {
            body.extend(f(v[0]));
            body.push(200);
            body.extend(f(v[1]));
            body.extend(f(v[2]));
        }
        if fixed {
            for i in [0, 1, 2, 0, 2, 3] {
                body.extend(u(i));
            }
        } else {
            body.extend(f(0.5));
            body.extend(if little { [4, 0] } else { [0, 4] });
            for i in 0..4 {
                body.extend(u(i));
            }
        }
        ply(&header, &body)
    };
    let corners = |t: [usize; 3]| t.map(|i| SQUARE[i]);
    let triangles = [corners([0, 1, 2]), corners([0, 2, 3])];
    let mut text = String::from("solid a b\n");
    let mut stl = vec![b' '; 80];
    stl[..5].copy_from_slice(b"solid");
    stl.extend(2u32.to_le_bytes());
    for t in triangles {
        text += "  facet normal 0 0 1\n outer loop\n";
        stl.extend([0; 12]);
        for v in t {
            text += &format!("   vertex {} {:e} {}\r\n", v[0], v[1], v[2]);
            stl.extend(v.iter().flat_map(|c| c.to_le_bytes()));
        }
        text += " endloop\n endfacet\n";
        stl.extend([0; 2]);
    }
    text += "endsolid a b\n";
    let mut obj = String::from("# a square\nmtllib a.mtl\no square\n");
    for v in SQUARE {
        obj += &format!("v {} {} {} 0.1 0.2 0.3\n", v[0], v[1], v[2]);
    }
    let ascii = ply(ASCII, b"0 0 0\n1 0 0.5\n1 1 0.25\n0 1 -0.125\n4 0 1 2 3\n");
    let negative = obj.clone() + "vn 0 0 1\nf -4//1 -3//1 \\\n -2//1 -1//1\n";
    obj += "vt 0 0\nf 1/1/1 2/1 3\nf 1 3 4 # the other half\n";
    vec![
        ("ascii PLY", ascii, MeshFormat::Ply),
        ("little PLY", binary(true, false), MeshFormat::Ply),
        ("big PLY", binary(false, false), MeshFormat::Ply),
        ("fixed little PLY", binary(true, true), MeshFormat::Ply),
        ("fixed big PLY", binary(false, true), MeshFormat::Ply),
        ("ascii STL", text.into_bytes(), MeshFormat::Stl),
        ("binary STL", stl, MeshFormat::Stl),
        ("OBJ", obj.into_bytes(), MeshFormat::Obj),
        ("negative OBJ", negative.into_bytes(), MeshFormat::Obj),
    ]
}

fn why(bytes: &[u8], format: MeshFormat) -> String {
    read_mesh_bytes(bytes, format).unwrap_err().to_string()
}

#[test]
fn every_encoding_gives_the_same_triangles() {
    for (name, bytes, format) in squares() {
        let (mesh, report) = read_mesh_bytes(&bytes, format).expect(name);
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]], "{name}");
        assert_eq!(mesh.vertices(), SQUARE, "{name}");
        assert_eq!(
            (mesh.parts().len(), mesh.parts()[0].name.as_str()),
            (1, "mesh")
        );
        let all = MeshReport {
            triangles: 2,
            left_out: LeftOut::default(),
            origin: [0.0; 3],
        };
        assert_eq!(report, all, "{name}");
    }
}

#[test]
fn files_cut_anywhere_are_refused_or_smaller_and_nothing_panics() {
    for (name, bytes, format) in squares() {
        for end in 0..bytes.len() {
            let read = read_mesh_bytes(&bytes[..end], format);
            // A text has no end mark in OBJ, and the last line's end is not missed in the others.
            let text = format == MeshFormat::Obj || name.starts_with("ascii");
            if !text {
                assert!(read.is_err(), "{name} cut at {end}");
            }
            if let Err(e) = read {
                let e = e.to_string();
                assert!(!e.chars().any(char::is_control) && e.len() < 500, "{e:?}");
            }
        }
        // Bytes changed one by one.
        for at in 0..bytes.len() {
            for value in [0, 0xFF, b'9', b'-', b' '] {
                let mut changed = bytes.clone();
                changed[at] = value;
                let _ = read_mesh_bytes(&changed, format);
            }
        }
    }
}

#[test]
fn what_was_written_comes_back_with_its_parts() {
    let part = |name: &str, reflectivity, new| Part {
        name: name.into(),
        material: Material {
            reflectivity,
            wet: 0.125,
        },
        new,
    };
    let mut mesh = Mesh::default();
    mesh.add(part("rock", 0.3, false), &SQUARE, &[[0, 1, 2], [0, 2, 3]])
        .unwrap();
    let moved = SQUARE.map(|v| [v[0] + 0.1, v[1], 3.0]);
    mesh.add(part("a new\npipe", 0.45, true), &moved, &[[3, 2, 1]])
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.PLY");
    write_mesh(&path, &mesh).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), to_ply_bytes(&mesh));
    let (back, report) = read_mesh(&path).unwrap();
    assert_eq!(report.triangles, 3);
    assert_eq!(back.part_of(), mesh.part_of());
    assert_eq!(back.parts()[0], mesh.parts()[0]);
    assert_eq!(back.parts()[1], part("a new pipe", 0.45, true));
    let mut changed = to_ply_bytes(&mesh);
    let at = changed.windows(4).position(|w| w == b"rock").unwrap();
    changed[at] = 7;
    let (read, _) = read_mesh_bytes(&changed, MeshFormat::Ply).unwrap();
    assert_eq!(read.parts()[0].name, " ock", "control characters of others");
    for i in 0..3 {
        assert_eq!(back.corners(i), mesh.corners(i));
    }
    assert_eq!(
        to_ply_bytes(
            &read_mesh_bytes(&to_ply_bytes(&back), MeshFormat::Ply)
                .unwrap()
                .0
        ),
        to_ply_bytes(&back)
    );
}

#[test]
fn a_survey_grid_keeps_its_precision() {
    let (e, n) = (431_234.567, 5_499_980.459);
    let obj = format!(
        "v {e} {n} 312.5\nv {} {n} 312.5\nv {e} {} 314.5\nf 1 2 3\n",
        e + 0.001,
        n + 2.0
    );
    let (mesh, report) = read_mesh_bytes(obj.as_bytes(), MeshFormat::Obj).unwrap();
    assert_eq!(report.origin, [431_235.0, 5_499_980.0, 0.0]);
    let [a, b, c] = mesh.corners(0).unwrap();
    assert!((b[0] - a[0] - 0.001).abs() < 1e-6 && (c[1] - a[1] - 2.0).abs() < 1e-6);
    assert!((f64::from(a[0]) + report.origin[0] - e).abs() < 1e-6);
    assert_eq!(a[2], 312.5);
}

#[test]
fn what_nothing_can_hit_is_left_out_and_said() {
    let body = b"0 0 0\n1 0 0.5\n1 1 0.25\n0 1e9 0\n";
    let header = ASCII.replace("face 1", "face 3");
    let faces = b"3 0 1 2\n4 0 1 2 3\n3 0 1 1\n";
    let (mesh, report) =
        read_mesh_bytes(&ply(&header, &[&body[..], faces].concat()), MeshFormat::Ply).unwrap();
    assert_eq!(mesh.triangles().len(), 2);
    let out = report.left_out;
    assert_eq!((report.triangles, out.broken, out.degenerate), (2, 1, 1));
}

#[test]
fn errors_name_the_place_and_the_remedy() {
    let far = |s: &str| why(s.as_bytes(), MeshFormat::Obj);
    assert!(far("v 0 0 0\nv 1 0 0\n").contains("no triangles (2 vertices)"));
    assert!(far("v 0 0 0\nf 1 2 3\n").contains("line 2: \"2\" is no vertex"));
    assert!(far("v 0 0 0\nf 0 1 1\n").contains("line 2"));
    assert!(far("v 0 0 0\nf 1 1\n").contains("three corners"));
    assert!(far("v 0 0 x\n").contains("line 1: \"x\" is no number"));
    assert!(far("v 0 0\n").contains("a coordinate is missing"));
    assert!(far("v nan 0 0\nf 1 1 1\n").contains("none of its 1 triangles"));
    let stl = |s: &[u8]| why(s, MeshFormat::Stl);
    assert!(stl(b"solid a\nfacet\nvertex 0 0 0\nendfacet\n").contains("line 4"));
    assert!(stl(b"solid a\nfacet\n").contains("endsolid"));
    assert!(stl(b"solid a\nendsolid\n").contains("no triangles"));
    assert!(stl(b"short").contains("too short"));
    assert!(stl(&[[0; 80].as_slice(), &[255; 4], &[0; 60]].concat()).contains("4294967295"));
    let bad = |header: &str, body: &[u8]| why(&ply(header, body), MeshFormat::Ply);
    assert!(why(b"solid", MeshFormat::Ply).contains("ply"));
    let square = b"0 0 0\n1 0 0.5\n1 1 0.25\n0 1 -0.125\n";
    let face = |f: &str| bad(ASCII, &[&square[..], f.as_bytes()].concat());
    assert!(face("3 0 1 4\n").contains("face 0 (from 0): vertex 4, but there are 4"));
    assert!(face("2 0 1\n").contains("2 corners"));
    assert!(face("3 0 1 -2\n").contains("vertex_indices"));
    assert!(face("").contains("ends too early"));
    let cloud = ASCII.split("element face").next().unwrap();
    assert!(bad(cloud, square).contains("not as a point cloud"));
    assert!(bad("format ascii 1.0\n", b"").contains("no vertices"));
    // Counts that no memory could hold are refused by the length of the file.
    for order in ["ascii", "binary_little_endian"] {
        let huge = ASCII
            .replace("ascii", order)
            .replace("vertex 4", "vertex 99999999999999");
        assert!(bad(&huge, square).contains("ends too early"));
        let empty = format!("format {order} 1.0\nelement nothing 99999999999999\n")
            + ASCII.strip_prefix("format ascii 1.0\n").unwrap();
        assert!(bad(&empty, square).contains("no properties"));
    }
    let read = |name: &str| read_mesh(Path::new(name)).unwrap_err().to_string();
    assert!(read("mine.dxf").contains("mine.dxf: no mesh by its name"));
    assert!(read("no_such.stl").contains("cannot be read"));
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the worlds of WINZE_DATA")]
fn real_worlds_are_read() {
    let root = std::env::var_os("WINZE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        Into::into,
    );
    for (file, triangles) in [
        ("worlds/tunnel_practice_1.ply", 175_778),
        ("worlds/rough_tunnel_tiles.ply", 149_070),
        ("worlds/cave_01.ply", 900_801),
        ("worlds/edgar_section_03.ply", 21_522),
        ("worlds/lava_tube.ply", 8_224),
        ("worlds/edgar_plan_roofless.ply", 22_557),
        ("gazebo_tunnel/world.ply", 54_088),
    ] {
        let (mesh, report) = read_mesh(&root.join(file)).unwrap();
        let LeftOut { broken, degenerate } = report.left_out;
        println!("{file}: {report:?} {:?}", mesh.bounds());
        assert_eq!(report.triangles + broken + degenerate, triangles, "{file}");
        assert!(degenerate < triangles / 50 && broken == 0, "{file}");
        assert_eq!(report.origin, [0.0; 3]);
    }
}
