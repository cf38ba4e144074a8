use super::*;
use crate::Results;
use crate::score::Missing;
use sequences::dataset::Attributes;
use sequences::{Annotation, Sequence};
use sequences::{Convention, Notes};
use testing::Folder;

#[test]
fn page_of_two_trackers_stands_alone_and_escapes_names() {
    let folder = Folder::new("report");
    let frame = folder.write(
        "f.ppm",
        [b"P6 8 6 255\n".as_slice(), &[99; 8 * 6 * 3]].concat(),
    );
    let boxes = vec![sequences::Rect::new(1.0, 1.0, 3.0, 3.0); 3];
    let annotation = Annotation::new("<b>&", boxes);
    folder.write("one/<b>&.txt", "1,1,3,3\n5,5,1,1\n5,5,1,1\n");
    folder.write("two/<b>&.txt", "1,1,3,3\n1,1,3,3\n1,1,3,3\n");
    let results = ["one", "two"].map(|at| Results::open(&folder.path().join(at)).unwrap());
    let mut notes = Notes::default();
    let rule = Convention::Got10k;
    let truth = [annotation.clone()];
    let compared = Comparison::read(
        &truth,
        &results,
        rule,
        Missing::Refuse,
        Attributes::new(),
        &mut notes,
    )
    .unwrap();
    let sequences = [Sequence {
        annotation,
        frames: vec![frame; 3],
    }];
    let failures = failures(&compared, &sequences, 5).unwrap();
    assert_eq!(
        (failures.len(), failures[0].frame, failures[0].lost),
        (1, 2, 2)
    );
    let diagnosis = crate::diagnosis::diagnose(&compared);
    let sheets = sheets(&compared, &diagnosis, &sequences, 5).unwrap();
    let html = page("a < b", &compared, &diagnosis, &failures, &sheets);
    assert!(html.contains("<h1>a &lt; b</h1>") && html.contains("data:image/jpeg;base64,/9j/"));
    assert!(!html.contains("<b>&<") && html.contains("&lt;b&gt;&amp;"));
    let text = html.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(
        !text.contains("http"),
        "the page asks for something from elsewhere"
    );
}
