use super::*;
use testing::Folder;

fn boxes(bytes: &[u8]) -> Result<Vec<Rect>, String> {
    let folder = Folder::new("text");
    let path = folder.write("boxes.txt", bytes);
    let display = path.display().to_string();
    read_boxes(&path).map_err(|error| error.to_string().replace(&display, "FILE"))
}

fn utf16(text: &str, to_bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
    text.encode_utf16().flat_map(to_bytes).collect()
}

#[test]
fn two_boxes_in_every_spelling_are_read_alike() {
    let expected = Ok(vec![
        Rect::new(1.0, 2.5, 3.0, 4.0),
        Rect::new(-5.0, 6.0, 7.0, 8.0),
    ]);
    let cases = [
        ("commas", "1,2.5,3,4\n-5,6,7,8\n"),
        ("no end of line", "1,2.5,3,4\n-5,6,7,8"),
        ("mark, CRLF", "\u{feff}1,2.5,3,4\r\n-5,6,7,8\r\n\r\n"),
        ("CR", "1,2.5,3,4\r-5,6,7,8\r"),
        ("CR CRLF", "1,2.5,3,4\r\r\n-5,6,7,8\r\r\n"),
        ("tabs", "1\t2.5\t3\t4\n-5\t6\t7\t8\n"),
        ("spaces", "  1 2.5   3.0 4\n-5 6 7 8\n\n\n"),
        ("no-break spaces", "1\u{a0}2.5\u{a0}3\u{a0}4\n-5 6 7 8\n"),
        ("confidence", "1, 2.5, 3, 4, 0.93\n-5,\t6, 7, 8, 0.5\n"),
        ("semicolons", "1;2.5;3;4\n-5;6e0;7;8\n"),
        ("semicolons and spaces", "1; 2.5; 3; 4\n-5; 6; 7; 8\n"),
        ("trailing commas", "1.000,2.500,3.000,4.000,\n-5,6,7,8,,\n"),
        ("blank first lines", "\n\n1,2.5,3,4\n-5,6,7,8\n"),
        ("decimal commas, semicolons", "1;2,5;3,0;4\n-5,0;6;7;8\n"),
        ("decimal commas, tabs", "1\t2,5\t3\t4\n-5,0\t6\t7\t8\n"),
        ("decimal commas, spaces", "1,0 2,5 3,0 4,0\n-5,0 6 7 8\n"),
        (
            "decimal commas, quotes",
            "\"1,0\",\"2,5\",\"3,0\",\"4,0\"\n-5,6,7,8\n",
        ),
        (
            "quotes",
            "\"1\",\"2.5\",\"3\",\"4\"\n\"-5\",\"6\",\"7\",\"8\"\n",
        ),
        ("header", "x,y,w,h\n1,2.5,3,4\n-5,6,7,8\n"),
        (
            "header with names",
            "Left;Top;Width;Height\n1;2,5;3;4\n-5;6;7;8\n",
        ),
        (
            "header in another order",
            "frame,w,h,x,y,score\n7,3,4,1,2.5,9\n8,7,8,-5,6,9\n",
        ),
        ("frame numbers from 0", "0,1,2.5,3,4\n1,-5,6,7,8\n"),
        ("frame numbers from 1", "1 1 2.5 3 4\n2 -5 6 7 8\n"),
        ("polygons", "1,2.5,4,2.5,4,6.5,1,6.5\n-5,6,2,6,2,14,-5,14\n"),
        ("polygon and box", "1,2.5,4,2.5,4,6.5,1,6.5\n-5,6,7,8\n"),
    ];
    for (what, text) in cases {
        assert_eq!(boxes(text.as_bytes()), expected, "{what}: {text:?}");
    }
    let text = "\u{feff}1,2.5,3,4\r\n-5,6,7,8\r\n";
    assert_eq!(boxes(&utf16(text, u16::to_le_bytes)), expected);
    assert_eq!(boxes(&utf16(text, u16::to_be_bytes)), expected);
}

#[test]
fn double_spaced_rows_are_read() {
    let found = boxes(b"1,2,3,4\n\n1,2,3,4\n\n1,2,3,4\n");

    assert_eq!(found.unwrap().len(), 3);
}

#[test]
fn turned_polygon_becomes_the_box_around_it() {
    let found = boxes(b"30,10,50,30,30,50,10,30\n");

    assert_eq!(found, Ok(vec![Rect::new(10.0, 10.0, 40.0, 40.0)]));
}

#[test]
fn frames_without_a_target_stay_rows() {
    let rows = [
        "NaN,nan,NAN,-nan",
        "NaN NaN NaN NaN",
        "inf,0,1,1",
        "NaN,NaN,NaN,NaN,NaN,NaN,NaN,NaN",
        "1,2,nan,4",
    ];
    for row in rows {
        let found = boxes(format!("1,2,3,4\n{row}\n1,2,3,4\n").as_bytes()).unwrap();
        assert_eq!(found.len(), 3, "{row}");
        assert!(found[1].has_nan(), "{row}");
    }
    let zeros = boxes(b"0,0,0,0\n0,0,0,0,0,0,0,0\n").unwrap();
    assert_eq!(zeros, [Rect::default(), Rect::default()]);
}

#[test]
fn fifth_column_that_counts_but_stays_below_one_is_a_confidence() {
    let found = boxes(b"0,10,20,30,0.5\n1,10,20,30,0.75\n");

    assert_eq!(found.unwrap()[1], Rect::new(1.0, 10.0, 20.0, 30.0));
}

#[test]
fn row_that_is_no_box_is_refused_by_line() {
    let cases: [(&[u8], &str); 17] = [
        (b"", "FILE: expected x,y,w,h per line, found an empty file"),
        (
            b"\r\n \n",
            "FILE: expected x,y,w,h per line, found an empty file",
        ),
        (
            b"x,y,w,h\n",
            "FILE: expected x,y,w,h per line, found an empty file",
        ),
        (
            b"1,2,3,4\n1,2,3\n",
            "line 2: expected x,y,w,h, found \"1,2,3\"",
        ),
        (b"1,2,3,4\n\n1,2,3,4\n", "line 2: expected x,y,w,h (NaN"),
        (
            b"1,2,3,4\ntotal 2\n",
            "line 2: expected x,y,w,h, found \"total 2\"",
        ),
        (b"x1,y1,x2,y2\n1,2,3,4\n", "line 1"),
        (b"\xff\xfe1\x00,\x002\x00", "line 1"),
        (b"1\x00,\x002\x00,\x003\x00,\x004\x00", "line 1"),
        (b"1,,3,4", "line 1"),
        (b"1,,3,4,5", "line 1"),
        (b",1,2,3,4", "line 1"),
        (b"1,2,3,4,5,6", "not 6 columns"),
        (b"1,-1,10,20,30,40,1,-1,-1,-1", "not 10 columns"),
        (b"684,8,273,116,0,0,0,0", "the four corners of a polygon"),
        (b"20,5,40,5,24,5,18,5", "the four corners of a polygon"),
        (
            b"frame,x,y,w,h\n1,1,2,3,4\n3,1,2,3,4\n",
            "line 3: expected frame 2",
        ),
    ];
    for (text, expected) in cases {
        let found = boxes(text).unwrap_err();
        let text = String::from_utf8_lossy(text);
        assert!(found.contains(expected), "{text:?}: {found}");
    }
    let missing = read_boxes(Path::new("/nonexistent/a.txt")).unwrap_err();
    let message = missing.to_string();
    assert!(
        message.starts_with("/nonexistent/a.txt: cannot be read"),
        "{message}"
    );
    let folder = read_boxes(Path::new(".")).unwrap_err().to_string();
    assert_eq!(folder, ".: expected a file, found a folder");
    #[cfg(unix)]
    {
        let device = read_boxes(Path::new("/dev/zero")).unwrap_err().to_string();
        assert!(device.contains("found a pipe or device"), "{device}");
    }
}

#[test]
fn seconds_and_flags_are_read() {
    let folder = Folder::new("numbers");
    let times = folder.write("times.txt", "0.5\r0,25\r\n0.125,9\n");
    let flags = folder.write("flags.txt", "0,1,0\n1 1;0\n");

    assert_eq!(read_numbers(&times).unwrap(), [0.5, 0.25, 0.125]);
    assert_eq!(
        read_all_numbers(&flags).unwrap(),
        [0.0, 1.0, 0.0, 1.0, 1.0, 0.0]
    );
}
