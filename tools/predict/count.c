/* A plugin for qemu's user mode that counts how often each block of a program runs.
 *
 * Arguments: out=FILE; code=ADDRESS of the program's first executable segment; mark=ADDRESS, which
 * may come several times. Whenever a marked block is about to run, and at the end, the plugin
 * writes what has run since the last mark: "ADDRESS INSTRUCTIONS TIMES" per block, then
 * "mark ADDRESS" or "end". All addresses are those of the program's file.
 */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Of qemu-plugin.h, which few distributions ship. */
typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
typedef void (*translated_t)(qemu_plugin_id_t, struct qemu_plugin_tb *);
typedef void (*executed_t)(unsigned, void *);
typedef void (*ended_t)(qemu_plugin_id_t, void *);
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t, translated_t);
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *, executed_t, int, void *);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t, ended_t, void *);
uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
uint64_t qemu_plugin_start_code(void);

#define EXPORT __attribute__((visibility("default")))
EXPORT int qemu_plugin_version = PLUGIN_VERSION;

struct block {
    struct block *next;
    uint64_t address, instructions, times, written;
};

static struct block *blocks;
static uint64_t marks[64], code;
static int mark_count;
static FILE *out;

static void write_blocks(void) {
    for (struct block *block = blocks; block; block = block->next) {
        uint64_t times = block->times - block->written;
        if (times > 0)
            fprintf(out, "%" PRIx64 " %" PRIu64 " %" PRIu64 "\n", block->address,
                    block->instructions, times);
        block->written = block->times;
    }
}

static void reach_mark(unsigned cpu, void *data) {
    write_blocks();
    fprintf(out, "mark %" PRIx64 "\n", ((struct block *)data)->address);
}

static void execute(unsigned cpu, void *data) { ((struct block *)data)->times++; }

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb) {
    struct block *block = calloc(1, sizeof *block);
    if (!block)
        abort();
    block->address = qemu_plugin_tb_vaddr(tb) - qemu_plugin_start_code() + code;
    block->instructions = qemu_plugin_tb_n_insns(tb);
    block->next = blocks;
    blocks = block;
    for (int i = 0; i < mark_count; i++)
        if (marks[i] == block->address)
            qemu_plugin_register_vcpu_tb_exec_cb(tb, reach_mark, 0, block);
    qemu_plugin_register_vcpu_tb_exec_cb(tb, execute, 0, block);
}

static void end(qemu_plugin_id_t id, void *data) {
    write_blocks();
    fprintf(out, "end\n");
    fclose(out);
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv) {
    for (int i = 0; i < argc; i++) {
        if (!strncmp(argv[i], "out=", 4))
            out = fopen(argv[i] + 4, "w");
        else if (!strncmp(argv[i], "code=", 5))
            code = strtoull(argv[i] + 5, NULL, 16);
        else if (!strncmp(argv[i], "mark=", 5) && mark_count < 64)
            marks[mark_count++] = strtoull(argv[i] + 5, NULL, 16);
    }
    if (!out)
        return -1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, end, NULL);
    return 0;
}
