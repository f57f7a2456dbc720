"""Constants that affect only how fast a program runs or compiles.

Each docstring says what the constant is, what it gains, and the commit where that was measured.
"Unknown" means that the measurement was not kept; measure these first on another machine. Unless
something else is said, measured on one core of an Intel Xeon with AVX-512, in float32, with some
hundred lanes. A lane is one environment of a batch.
"""

# --- Sections: what a CPU runs as one function (`batching.sections`) ---

SECTION_MIN = 32
"""Equations from which a section repays its call.

Gains: hopper's step takes 0.6 of its time with sections; of the limit itself, unknown.
Seen: 335c303.
"""
SECTION_MAX = 800
"""Equations of a section, those of its loops counted once.

Gains: Gymnasium's humanoid a fifth, against larger sections, whose compilation by LLVM is longer.
Seen: 3590b54.
"""
SECTION_LOOP = 5000
"""Equations up to which a `while` is one section: a divided loop copies what it carries each turn.

Gains: unknown.
Seen: 82e7b75.
"""
SELECTED_ROWS = 4
"""Rows of a concatenation that share a loop, in which each is computed for every row.

Gains: a cross product of 4 vectors in 32 lanes takes 28 ns with three rows in a loop, else 33.
Seen: de5c15a.
"""

# --- Calls and loops of a batch (`batching.primitives.calls`, `while_loop`) ---

INLINED_EQUATIONS = 16
"""Equations of a jitted function below which it becomes part of its caller.

Gains: unknown; larger ones are traced and compiled once for all calls.
Seen: 2d5cb4a.
"""
COMPACTION_DIVISOR = 8
"""A batched `while` goes on with the lanes that are left when this part of them is.

Gains: Gymnasium's humanoid takes 0.92 of the time that it takes with a quarter.
Seen: 17990dc.
"""
COMPACTION_MIN = 16
"""Lanes that a compacted loop has at least: LLVM unrolls loops over so few before it vectorises.

Gains: 32 of 128 lanes take longer than 16; by how much, unknown.
Seen: 6eee407.
"""
COMPACTION_GAIN = 4
"""Times fewer lanes that repay moving them.

Gains: unknown.
Seen: 6eee407.
"""
COMPACTION_BODY = 300
"""Equations of a loop's body from which a second copy of the loop repays its compilation.

Gains: unknown.
Seen: b407a6f.
"""

# --- Products of small matrices (`batching.primitives.products`) ---

PRODUCT_TERMS = 32
"""Terms of a sum of products that is unrolled, where both operands have lanes.

Gains: 256 lanes of (12,12)x(12,12) take 37 us, as `dot_general` 87; of (27,27)x(27,27) 280 and 350;
but of (8,128)x(128,8) 7600 and 390.
Seen: 2d5cb4a.
"""
PRODUCT_TERMS_VECTOR = 64
"""The same where the result has at most as many entries as an operand.

Gains: 256 lanes of (27,27)x(27,) take 18 us, as `dot_general` 109.
Seen: 2d5cb4a.
"""
PRODUCT_TERMS_SHARED = 8
"""The same where all lanes share one operand: the batch is then an axis of one matrix product.

Gains: the product is as fast from 8 terms on, and then faster.
Seen: 2d5cb4a.
"""
PRODUCT_MULTIPLICATIONS = 32768
"""Multiplications of one lane up to which a product is unrolled.

Gains: bounds the size of the program; unknown.
Seen: 2d5cb4a.
"""
PRODUCT_CALL = 6
"""Multiplications of one lane from which a product is a kernel of its own.

Gains: unknown.
Seen: 03888ab.
"""

# --- Reductions, factors and sums of cotangents of a batch ---

REDUCED_ENTRIES = 8192
"""Entries of one lane whose reduction is written out: XLA does not vectorise one of leading axes.

Gains: unknown.
Seen: 6488763.
"""
REDUCED_AT_ONCE = 8
"""Parts of an axis that one expression of such a reduction adds.

Gains: unknown.
Seen: 02f109a.
"""
UNROLLED_ROWS = 6
"""Rows of a matrix whose factors and substitutions are unrolled.

Gains: unrolled, XLA's fusion computes columns again: 27 rows of 256 lanes take 2.7 to 5 ms and 10 s
to compile, in a loop over columns .38 ms, by LAPACK .52. A loop for LU takes half of LAPACK's time.
Seen: 2d5cb4a.
"""
LOOPED_ROWS = 32
"""Rows of a Cholesky factor by a loop over columns; larger ones are LAPACK's.

Gains: as above at 27 rows; where it ends, unknown.
Seen: 2d5cb4a.
"""
LOOPED_ENTRIES = 1024
"""Entries of a triangular solve's result, rows times columns, by such a loop.

Gains: one right-hand side of 27 rows in 256 lanes takes 21 us, by LAPACK 232.
Seen: 2d5cb4a.
"""
PADDED_REGIONS = 64
"""Regions of a sum of padded arrays that are written one by one; beyond them, paddings are added.

Gains: bounds the size of the program; unknown.
Seen: b0a7eb8.
"""

# --- Gathers and sums over indices that are known (`arrays.indexing`) ---

SLICES = 16
"""Slices that replace a gather.

Gains: unknown.
Seen: dd9779f.
"""
SUMMED_ROWS = 8
"""Rows of a group whose sum is written out, which fuses better than a reduction.

Gains: unknown.
Seen: da86ced.
"""

# --- Trees and constraints ---

SCANNED_LEVELS = 8
"""Equal levels of a tree from which they are a `scan`: the program does not grow with depth.

Gains: shorter runs are faster unrolled; by how much, unknown.
Seen: ce969b1.
"""
PRODUCT_NODES = 8
"""Nodes of a deep tree up to which its sums are one product, with the square of so many additions.

Gains: with rows that share a loop, hopper's program has a third less to compile.
Seen: de5c15a.
"""
ONE_HOT_PAIRS = 512
"""Pairs of rows and links up to which a sum over links is a product and no scatter.

Gains: a scatter goes number by number and is in no section; in time, unknown.
Seen: 626c5cd.
"""
DENSE_DOFS = 64
"""Degrees of freedom up to which a dense factor is cheaper than conjugate gradients.

Gains: unknown.
Seen: 1c78307.
"""
UNROLLED_EVALUATIONS = 8
"""Evaluations of a line search that are unrolled.

Gains: no cost of a loop, few operations; unknown.
Seen: b322067.
"""
COMPACTED_CONTACTS = 8
"""Slots of contacts that an articulated solve keeps where no more push in a batch.

Gains: unknown.
Seen: 303714b.
"""
COMPACTION_CONTACTS = 12
"""Slots from which so few repay the compilation of a second program.

Gains: unknown.
Seen: 303714b.
"""

# --- Chunks of a batch (`parallel.chunks`) ---

VECTOR = 16
"""Numbers of a processor's vector: lanes of a chunk are a multiple, as others are left over.

Gains: unknown.
Seen: e8320ea.
"""
CHUNK_UNROLLED = 12288, 64, 128
"""Where XLA unrolls loops over few lanes: links in cache, and lanes of a chunk, least and most.

Gains: unknown.
Seen: 1619d08.
"""
CHUNK_KEPT = 1536, 16, 64
"""As `CHUNK_UNROLLED`, where `configure_cpu` forbids unrolling; a chunk fits the first-level cache.

Gains: Gymnasium's humanoid takes 0.74 of its time, compilation 0.65.
Seen: 1619d08.
"""
