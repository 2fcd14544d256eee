//! Files as their formats have them, in which any count, size and length may stand: a header that
//! fits itself gets farther into a reader than noise does.

use flate2::{Compression, write::ZlibEncoder};
use proptest::{collection::vec, option, prelude::*, sample::select};
use std::io::Write;

/// Counts and lengths: few, some, and more than there can be.
const COUNTS: [u64; 10] = [0, 1, 2, 3, 17, 300, 65_537, 1_000_000_000, u32::MAX as u64, u64::MAX];
/// Sizes of pictures.
const SIZES: [u32; 10] = [0, 1, 2, 24, 300, 4096, 20_000, 100_000, i32::MAX as u32, u32::MAX];

/// Bytes behind a header.
fn body() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        vec(any::<u8>(), 0..600),
        (0..3000_usize).prop_map(|len| vec![0; len]),
        (0..3000_usize).prop_map(|len| vec![0xff; len]),
        (0..3000_usize).prop_map(|len| b"1 ".repeat(len)),
        (0..3000_usize).prop_map(|len| b"0\n".repeat(len)),
    ]
}

/// PLY: elements with any properties and counts, vertices among them.
pub(crate) fn ply() -> impl Strategy<Value = Vec<u8>> {
    let scalar = || select(&["char", "uchar", "short", "ushort", "int", "uint", "float", "double"][..]);
    let property = prop_oneof![
        scalar().prop_map(|scalar| format!("property {scalar} ")),
        (scalar(), scalar()).prop_map(|(index, item)| format!("property list {index} {item} ")),
    ];
    let name = select(&["x", "y", "z", "red", "near"][..]);
    let element = (
        select(&["junk", "face", "vertex", "camera"][..]),
        select(&COUNTS[..]),
        vec((property, name).prop_map(|(property, name)| format!("{property}{name}\n")), 0..6),
    );
    let element = element.prop_map(|(name, count, lines)| format!("element {name} {count}\n{}", lines.concat()));
    let points = (select(&COUNTS[..]), vec(scalar(), 3)).prop_map(|(count, kinds)| {
        format!("element vertex {count}\nproperty {} x\nproperty {} y\nproperty {} z\n", kinds[0], kinds[1], kinds[2])
    });
    let format = select(&["ascii", "binary_little_endian", "binary_big_endian"][..]);
    (format, vec(element, 0..4), points, body()).prop_map(|(format, elements, points, body)| {
        let header = format!("ply\nformat {format} 1.0\n{}{points}end_header\n", elements.concat());
        [header.as_bytes(), &body].concat()
    })
}

/// PNG: any kind of pixels and size, chunks with the sums that belong to them, and streams that
/// unpack to far more.
pub(crate) fn png() -> impl Strategy<Value = Vec<u8>> {
    let stream = || {
        (0..1_usize << 20, any::<u8>()).prop_map(|(len, byte)| {
            let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
            packed.write_all(&vec![byte; len]).unwrap();
            packed.finish().unwrap()
        })
    };
    let names = [b"IDAT", b"PLTE", b"tRNS", b"tEXt", b"eXIf", b"gAMA", b"acTL", b"fcTL", b"fdAT", b"zTXt", b"iCCP"];
    let data = prop_oneof![
        vec(any::<u8>(), 0..40),
        stream(),
        stream().prop_map(|stream| [&b"name\0\0"[..], &stream].concat()),
    ];
    let small = 1..40_u32;
    let size = || prop_oneof![small.clone(), select(&SIZES[..])];
    let header = (size(), size(), select(&[1, 2, 3, 4, 8, 16][..]), 0..7_u8, 0..3_u8);
    (header, vec((select(names.to_vec()), data), 0..4), stream()).prop_map(
        |((width, height, depth, color, interlace), chunks, pixels)| {
            let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
            let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[depth, color, 0, 0, interlace]].concat();
            write_chunk(&mut file, b"IHDR", &header);
            chunks.iter().for_each(|(name, data)| write_chunk(&mut file, name, data));
            write_chunk(&mut file, b"IDAT", &pixels);
            write_chunk(&mut file, b"IEND", &[]);
            file
        },
    )
}

fn write_chunk(file: &mut Vec<u8>, name: &[u8; 4], data: &[u8]) {
    let inside = [&name[..], data].concat();
    file.extend((data.len() as u32).to_be_bytes());
    file.extend(&inside);
    file.extend(crc32fast::hash(&inside).to_be_bytes());
}

/// Checkpoints: tensors of any type, shape and place, and any numbers in what the header says
/// besides.
pub(crate) fn safetensors() -> impl Strategy<Value = Vec<u8>> {
    let names =
        ["gaussians", "gaussians.mean", "gaussians.square", "grad_sum", "view_count", "light", "order", "other"];
    let number =
        || prop_oneof![Just("0"), Just("1"), Just("16"), Just("-1"), Just("1e20"), Just("18446744073709551615")];
    let shape = vec(select(&COUNTS[..]), 0..4);
    let place = (select(&COUNTS[..]), select(&COUNTS[..]));
    let tensor = (select(names.to_vec()), select(&["F32", "U32", "F64", "BOOL"][..]), shape, place);
    let tensor = tensor.prop_map(|(name, kind, shape, (start, end))| {
        format!("\"{name}\":{{\"dtype\":\"{kind}\",\"shape\":{shape:?},\"data_offsets\":[{start},{end}]}}")
    });
    let facts = vec(number(), 6).prop_map(|numbers| {
        let [iteration, seconds, nonfinite, gaussians, resolution, exposures] = numbers[..] else { return String::new() };
        format!(
            "{{\"format\":1,\"facts\":{{\"program\":\"\",\"iteration\":{iteration},\"iterations\":1,\"seconds\":{seconds},\
             \"psnr\":null,\"nonfinite\":{nonfinite},\"seed\":0,\"config\":\"\",\"settings\":\"\",\"views\":1,\
             \"pictures\":\"\"}},\"gaussians\":{gaussians},\"is_shaded\":true,\"sh_degree\":0,\"light\":\
             {{\"resolution\":{resolution},\"is_exponential\":true}},\"exposures\":{exposures}}}"
        )
    });
    let lie = option::weighted(0.2, select(&COUNTS[..]));
    (facts, vec(tensor, 0..9), lie, body()).prop_map(|(facts, tensors, lie, body)| {
        let ours = format!("\"__metadata__\":{{\"specula\":\"{}\"}}", facts.replace('"', "\\\""));
        let header = format!("{{{}}}", [&[ours][..], &tensors].concat().join(","));
        let len = lie.unwrap_or(header.len() as u64);
        [&len.to_le_bytes()[..], header.as_bytes(), &body].concat()
    })
}

/// ONNX: messages within messages with any fields, whose lengths mostly fit.
pub(crate) fn onnx() -> impl Strategy<Value = Vec<u8>> {
    let number = prop_oneof![
        any::<u8>().prop_map(|byte| vec![byte & 0x7f]),
        any::<u64>().prop_map(varint),
        Just(vec![0xff; 10]),
    ];
    let numbers = vec(number.clone(), 0..5).prop_map(|numbers| numbers.concat());
    let leaf = prop_oneof![vec(any::<u8>(), 0..20), numbers, vec(b'a'..=b'z', 0..6)];
    let message = leaf.prop_recursive(6, 200, 8, move |inside| {
        let with_len = (field(), inside, option::weighted(0.05, any::<u64>())).prop_map(|(field, bytes, lie)| {
            [varint(field << 3 | 2), varint(lie.unwrap_or(bytes.len() as u64)), bytes].concat()
        });
        let plain = (field(), number.clone()).prop_map(|(field, number)| [varint(field << 3), number].concat());
        let fixed = (field(), any::<[u8; 8]>(), any::<bool>()).prop_map(|(field, bytes, is_long)| match is_long {
            true => [varint(field << 3 | 1), bytes.to_vec()].concat(),
            false => [varint(field << 3 | 5), bytes[..4].to_vec()].concat(),
        });
        vec(prop_oneof![6 => with_len, 2 => plain, 1 => fixed], 0..8).prop_map(|fields| fields.concat())
    });
    // A graph, of which all else is part.
    (message, vec(any::<u8>(), 0..3))
        .prop_map(|(graph, rest)| [&[0x08, 8, 0x3a][..], &varint(graph.len() as u64), &graph, &rest].concat())
}

fn field() -> impl Strategy<Value = u64> {
    prop_oneof![8 => 1..15_u64, 1 => any::<u64>().prop_map(|field| field >> 3)]
}

fn varint(mut number: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

/// OpenEXR: channels of any kind and sampling, windows and tiles of any size, any way of packing.
pub(crate) fn exr() -> impl Strategy<Value = Vec<u8>> {
    let edge = || prop_oneof![4 => 0..40_i32, 1 => select(&[-1, 300, 100_000, i32::MAX, i32::MIN][..])];
    let window = || (edge(), edge(), edge(), edge());
    let sampling = || prop_oneof![6 => Just(1), 1 => select(&[0, 2, 7, -1, i32::MAX][..])];
    let channel = (select(&["A", "B", "G", "R", "X", "view.left.R"][..]), 0..4_i32, sampling(), sampling());
    let many = prop_oneof![6 => 0..3_usize, 1 => 0..3000_usize];
    let tiles = option::of((edge(), edge(), any::<u8>()));
    let flags = prop_oneof![6 => Just(0), 1 => select(&[0x200, 0x400, 0x800, 0x1000, 0x1a00][..])];
    (flags, vec(channel, 0..5), many, 0..11_u8, (window(), window()), tiles, option::of(edge()), body()).prop_map(
        |(flags, others, many, compression, windows, tiles, chunks, body)| {
            let flags = if tiles.is_some() { flags | 0x200 } else { flags };
            let mut file = [0x0131_2f76_i32, 2 | flags].map(i32::to_le_bytes).concat();
            let colors = ["B", "G", "R"].map(|name| (name.to_owned(), 2, 1, 1));
            let others = others.into_iter().map(|(name, kind, x, y)| (name.to_owned(), kind, x, y));
            let same = (0..many).map(|k| (format!("c{k}"), 2, 1, 1));
            // In the order of their names, or a file is refused at once.
            let mut all: Vec<(String, i32, i32, i32)> = colors.into_iter().chain(others).chain(same).collect();
            all.sort();
            all.dedup_by(|one, other| one.0 == other.0);
            let mut channels: Vec<u8> = Vec::new();
            all.iter().for_each(|(name, kind, x, y)| write_channel(&mut channels, name, [*kind, 0, *x, *y]));
            channels.push(0);
            let box_of = |(a, b, c, d): (i32, i32, i32, i32)| [a, b, c, d].map(i32::to_le_bytes).concat();
            write_attribute(&mut file, "channels", "chlist", &channels);
            write_attribute(&mut file, "compression", "compression", &[compression]);
            write_attribute(&mut file, "dataWindow", "box2i", &box_of(windows.0));
            write_attribute(&mut file, "displayWindow", "box2i", &box_of(windows.1));
            write_attribute(&mut file, "lineOrder", "lineOrder", &[0]);
            write_attribute(&mut file, "pixelAspectRatio", "float", &1_f32.to_le_bytes());
            write_attribute(&mut file, "screenWindowCenter", "v2f", &[0; 8]);
            write_attribute(&mut file, "screenWindowWidth", "float", &1_f32.to_le_bytes());
            if let Some((width, height, mode)) = tiles {
                let tiles = [&width.to_le_bytes()[..], &height.to_le_bytes(), &[mode & 0x12]].concat();
                write_attribute(&mut file, "tiles", "tiledesc", &tiles);
            }
            if let Some(count) = chunks {
                write_attribute(&mut file, "chunkCount", "int", &count.to_le_bytes());
            }
            file.push(0);
            [file, body].concat()
        },
    )
}

fn write_channel(channels: &mut Vec<u8>, name: &str, [kind, linear, x, y]: [i32; 4]) {
    channels.extend([name.as_bytes(), &[0]].concat());
    channels.extend([kind, linear, x, y].map(i32::to_le_bytes).concat());
}

fn write_attribute(file: &mut Vec<u8>, name: &str, kind: &str, value: &[u8]) {
    file.extend([name.as_bytes(), &[0], kind.as_bytes(), &[0]].concat());
    file.extend((value.len() as u32).to_le_bytes());
    file.extend(value);
}

/// Radiance's format: any size, and runs of any length.
pub(crate) fn hdr() -> impl Strategy<Value = Vec<u8>> {
    let size = || prop_oneof![1..40_u32, select(&SIZES[..])];
    let line = (any::<u16>(), vec((any::<u8>(), any::<u8>()), 0..200)).prop_map(|(width, runs)| {
        let runs: Vec<u8> = runs.into_iter().flat_map(|(len, byte)| [len, byte]).collect();
        [&[2, 2][..], &(width % 300).to_be_bytes(), &runs].concat()
    });
    (size(), size(), vec(line, 0..5), body()).prop_map(|(width, height, lines, body)| {
        let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n");
        [header.as_bytes(), &lines.concat(), &body].concat()
    })
}

/// JSON: values within values, of which each takes more room than its text.
pub(crate) fn json() -> impl Strategy<Value = Vec<u8>> {
    /// Text at most, unless a single value is longer.
    const LEN_MAX: usize = 1 << 15;
    let leaf =
        select(&["0", "[]", "{}", "null", "1e999", "\"\"", "-1", "[[[[", "{\"\":0}"][..]).prop_map(str::to_owned);
    let key = select(&["version", "iterations", "orientation", "bearings", "rest", "", "seed"][..]);
    let value = leaf.prop_recursive(5, 200, 10, move |inside| {
        prop_oneof![
            vec(inside.clone(), 0..10).prop_map(|values| format!("[{}]", values.join(","))),
            vec((key.clone(), inside), 0..10).prop_map(|pairs| {
                let pairs: Vec<String> = pairs.iter().map(|(key, value)| format!("\"{key}\":{value}")).collect();
                format!("{{{}}}", pairs.join(","))
            }),
        ]
    });
    (value, 1..1000_usize).prop_map(|(value, times)| {
        let times = times.min(LEN_MAX / (value.len() + 1) + 1);
        format!("{{\"other\":[{}]}}", vec![value; times].join(",")).into_bytes()
    })
}
