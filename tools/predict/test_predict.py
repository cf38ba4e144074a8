"""Tests of the parsers, on samples of what qemu, llvm-objdump and llvm-mca write."""

import json
import unittest

import cycles
import listing
import trace

LISTING = """
track-cpu:	file format elf64-littleaarch64

0000000000001000 <kernels::conv::direct::add[4f2a91bc03de7788]>:
    1000:      	ldr	q0, [x1], #0x10
    1004:      	fmla	v1.4s, v0.4s, v2.s[0]   // comment
    1008:      	b.ne	0x1000 <kernels::conv::direct::add[4f2a91bc03de7788]>
    100c:      	ret

0000000000001010 <memcpy>:
    1010:      	adrp	x0, 0x5000 <data+0x10>
    1014:      	ret
"""
MARKS = trace.Marks(clock=1, passes=2, convolutions=[3, 4], pooled=[3])
LAYERS = {"backbone": [("conv1", True), ("conv2", False)], "dr": [], "neck": [], "head": []}


class ListingTest(unittest.TestCase):
    def setUp(self):
        self.functions = listing.parse(LISTING.splitlines())

    def test_listing_gives_functions_without_hashes_and_comments(self):
        names = [name for name, _ in self.functions]

        self.assertEqual(names, ["kernels::conv::direct::add", "memcpy"])
        self.assertEqual(self.functions[0][1][1].text, "fmla v1.4s, v0.4s, v2.s[0]")

    def test_source_of_jumps_and_addresses_names_no_place(self):
        loop, copy = [listing.source(body) for _, body in self.functions]

        self.assertEqual(loop[2], "b.ne 0")
        self.assertEqual(copy[0], "adrp x0, 0")

    def test_blocks_that_overlap_add_up_and_a_loop_is_one_stretch(self):
        blocks = {(0x1000, 3): 10, (0x1008, 2): 1, (0x100C, 1): 1, (0x9000, 5): 7}

        counts = listing.executions(self.functions, blocks)
        found = list(listing.stretches(self.functions[0][1], [counts]))

        self.assertEqual([counts[a] for a in (0x1000, 0x1004, 0x1008, 0x100C)], [10, 10, 11, 2])
        self.assertEqual(found, [(0, 2), (2, 3), (3, 4)])

    def test_stretch_that_jumps_into_itself_is_a_loop(self):
        body = self.functions[0][1]

        self.assertTrue(listing.is_loop(body[:3]))
        self.assertFalse(listing.is_loop(body[:2]))
        self.assertFalse(listing.is_loop(body[2:]))


class TraceTest(unittest.TestCase):
    def frame(self, times):
        """A frame as the plugin writes it: a crop, a layer in two bands, another, the rest."""
        layers = ["mark 3", f"{0x30:x} 1 5", "mark 4", f"40 1 {times}", "mark 4", f"40 1 {times}"]
        layers += ["mark 4", "41 1 9"]
        after = [line for _ in range(7) for line in ("mark 1", "50 1 1")]
        learning = ["mark 1", "60 1 3", "mark 1", "mark 4", "61 1 4"]
        crop = ["mark 1", "20 1 2", "mark 1"]
        return [*crop, "mark 2", "mark 1", *layers, *after, *learning]

    def test_rows_are_layers_stages_and_learning_of_the_frames_alone(self):
        segments = trace.Segments(MARKS, LAYERS)
        inits = [*self.frame(100), *self.frame(100)]
        lines = [*inits, *self.frame(1), *self.frame(3), "mark 1", "70 1 99", "end"]

        trace.read(lines, segments)
        rows = segments.per_frame(2)

        self.assertEqual(rows["backbone", "conv1"], {(0x30, 1): 5, (0x40, 1): 4})
        self.assertEqual(rows["backbone", "conv2"], {(0x41, 1): 9})
        self.assertEqual(rows["crop", "crop"], {(0x20, 1): 2})
        self.assertEqual(rows["neck", "template update"], {(0x61, 1): 4})
        self.assertNotIn((0x70, 1), {block for blocks in rows.values() for block in blocks})

    def test_more_passes_than_frames_are_refused(self):
        segments = trace.Segments(MARKS, LAYERS)

        trace.read([line for _ in range(4) for line in self.frame(1)], segments)

        with self.assertRaises(SystemExit):
            segments.per_frame(1)

    def test_layers_without_their_calls_are_refused(self):
        with self.assertRaises(SystemExit):
            list(trace.assign([("a", True), ("b", False)], [({}, True)]))

    def test_layers_of_the_report_are_in_the_order_of_a_search(self):
        names = ["backbone.conv1", "backbone.pool1", "neck.template_cls", "neck.search_cls"]
        names += ["head.cls1", "head.reg1", "head.score", "head.offsets"]
        listed = [{"name": n, "algorithm": None if "pool" in n else "int8"} for n in names]

        found = trace.layers({"layers": listed})

        self.assertEqual(found["backbone"], [("backbone.conv1", True)])
        self.assertEqual(found["neck"], [("neck.search_cls", False)])
        head = [name for name, _ in found["head"]]
        self.assertEqual(head, ["head.cls1", "head.score", "head.reg1", "head.offsets"])


class CyclesTest(unittest.TestCase):
    def test_cycles_wait_for_results_in_loops_alone_and_for_decoding_always(self):
        def region(name, total, throughput):
            summary = {"Instructions": 800, "TotalCycles": total, "BlockRThroughput": throughput}
            return {"Name": name, "SummaryView": summary}

        regions = [region("1", 900, 3.0), region("0", 100, 1.0), region("2", 900, 3.0)]

        found = cycles.parse(
            json.dumps({"CodeRegions": regions}), cycles.CPUS["cortex-a76"], [True, True, False]
        )

        self.assertEqual(found, [2.0, 9.0, 3.0])


if __name__ == "__main__":
    unittest.main()
