//! `update` allocates nothing after its first call, on every instruction set.

use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};

#[test]
fn update_after_the_first_allocates_nothing() {
    let data: Vec<u8> = (0..320 * 240 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let orders = [ChannelOrder::Rgb, ChannelOrder::Nv12];
    let frames = orders.map(|order| Frame::new(&data, 320, 240, order).unwrap());
    for (isa, frame) in Isa::available()
        .into_iter()
        .flat_map(|isa| frames.map(|frame| (isa, frame)))
    {
        let mut tracker = Tracker::new(Model::builtin(isa));
        let first = allocation_counter::measure(|| {
            tracker
                .init(&frame, BBox::new(100.0, 80.0, 40.0, 30.0))
                .unwrap();
            tracker.update(&frame).unwrap();
        });
        assert!(first.count_total > 0, "the counter counts");
        let later = allocation_counter::measure(|| {
            for _ in 0..5 {
                tracker.update(&frame).unwrap();
            }
        });
        assert_eq!(later.count_total, 0, "allocations on {isa}");
    }
}
