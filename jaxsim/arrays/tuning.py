"""Constants that affect only how fast a program runs or compiles.

Each docstring says what the constant is, what it gains, and the commit where that was measured.
"Unknown" means that the measurement was not kept; measure these first on another machine. Unless
something else is said, measured on one core of an Intel Xeon with AVX-512, in float32, with some
hundred lanes. A lane is one environment of a batch.
"""

# --- Sections: what a CPU runs as one function (`batching.sections`) ---

SECTION_MIN = 32
"""Least number of equations of a section; below it, the call costs more than the section saves.

Gains: with sections, a step of hopper takes 0.6 of the time; of this limit alone, unknown.
Seen: 335c303.
"""
SECTION_MAX = 800
"""Largest number of equations of a section, with the equations of its loops counted once.

Gains: a fifth of the time of Gymnasium's humanoid; LLVM also takes longer to compile larger ones.
Seen: 3590b54.
"""
SECTION_LOOP = 5000
"""Largest number of equations of a `while` that is one section.

A loop in several sections copies the values that it carries in every iteration.

Gains: unknown.
Seen: 82e7b75.
"""
SELECTED_ROWS = 4
"""Largest number of rows of a concatenation that are computed in one loop, each for every row.

Gains: a cross product of 4 vectors in 32 lanes takes 28 ns with three rows in a loop, else 33.
Seen: de5c15a.
"""

# --- Calls and loops of a batch (`batching.primitives.calls`, `while_loop`) ---

INLINED_EQUATIONS = 16
"""Number of equations below which a jitted function is inlined in its caller.

Gains: unknown. A larger function is traced and compiled once for all its calls.
Seen: 2d5cb4a.
"""
COMPACTION_DIVISOR = 8
"""A batched `while` is compacted when at most this fraction (one over it) of the lanes is active.

Gains: Gymnasium's humanoid takes 0.92 of the time that it takes with a quarter.
Seen: 17990dc.
"""
COMPACTION_MIN = 16
"""Least number of lanes of a compacted loop; LLVM unrolls shorter ones and does not vectorise them.

Gains: 16 of 128 lanes are faster than 32; by how much, unknown.
Seen: 6eee407.
"""
COMPACTION_GAIN = 4
"""Least factor by which compaction must reduce the number of lanes to repay the gather.

Gains: unknown.
Seen: 6eee407.
"""
COMPACTION_BODY = 300
"""Least number of equations of a loop's body for which a compacted copy repays its compilation.

Gains: unknown.
Seen: b407a6f.
"""

# --- Products of small matrices (`batching.primitives.products`) ---

PRODUCT_TERMS = 32
"""Largest number of terms of an unrolled inner product, where both operands have lanes.

Gains: 256 lanes of (12,12)x(12,12) take 37 us, as `dot_general` 87; of (27,27)x(27,27) 280 and 350;
but of (8,128)x(128,8) 7600 and 390.
Seen: 2d5cb4a.
"""
PRODUCT_TERMS_VECTOR = 64
"""As `PRODUCT_TERMS`, where the result has no more entries than one of the operands.

Gains: 256 lanes of (27,27)x(27,) take 18 us, as `dot_general` 109.
Seen: 2d5cb4a.
"""
PRODUCT_TERMS_SHARED = 8
"""As `PRODUCT_TERMS`, where all lanes share one operand.

The batch is then an axis of one matrix product.

Gains: that product is as fast with 8 terms and faster with more.
Seen: 2d5cb4a.
"""
PRODUCT_MULTIPLICATIONS = 32768
"""Largest number of multiplications for each lane of a product that is unrolled.

Gains: bounds the size of the program; unknown.
Seen: 2d5cb4a.
"""
PRODUCT_CALL = 6
"""Least number of multiplications for each lane of a product that gets its own kernel.

Gains: unknown.
Seen: 03888ab.
"""

# --- Reductions, factors and sums of cotangents of a batch ---

REDUCED_ENTRIES = 8192
"""Largest number of entries for each lane of a reduction that is unrolled.

XLA does not vectorise a reduction over leading axes.

Gains: unknown.
Seen: 6488763.
"""
REDUCED_AT_ONCE = 8
"""Number of slices that one expression of an unrolled reduction adds.

Gains: unknown.
Seen: 02f109a.
"""
UNROLLED_ROWS = 6
"""Largest number of rows of a matrix whose factorisation and substitutions are unrolled.

Gains: XLA's fusion recomputes columns of larger ones: in 256 lanes, 27 rows take 2.7 to 5 ms and
10 s to compile; a loop over columns takes 0.38 ms, LAPACK 0.52. For LU a loop takes half of LAPACK.
Seen: 2d5cb4a.
"""
LOOPED_ROWS = 32
"""Largest number of rows of a Cholesky factor by a loop over columns; above it, LAPACK is called.

Gains: as for `UNROLLED_ROWS` at 27 rows; at the limit, unknown.
Seen: 2d5cb4a.
"""
LOOPED_ENTRIES = 1024
"""Largest number of entries of the result of a triangular solve by a loop over columns.

Gains: one right-hand side of 27 rows in 256 lanes takes 21 us, by LAPACK 232.
Seen: 2d5cb4a.
"""
PADDED_REGIONS = 64
"""Largest number of regions of a sum of padded arrays that are written one by one.

Above it, the padded arrays are added.

Gains: bounds the size of the program; unknown.
Seen: b0a7eb8.
"""

# --- Gathers and sums over indices that are known (`arrays.indexing`) ---

SLICES = 16
"""Largest number of slices that replace a gather.

Gains: unknown.
Seen: dd9779f.
"""
SUMMED_ROWS = 8
"""Largest number of rows of a group whose sum is unrolled, which fuses better than a reduction.

Gains: unknown.
Seen: da86ced.
"""

# --- Trees and constraints ---

SCANNED_LEVELS = 8
"""Least number of equal consecutive levels of a tree that become a `scan`.

A scan keeps the size of the program independent of the depth; shorter runs are faster unrolled.

Gains: unknown.
Seen: ce969b1.
"""
PRODUCT_NODES = 8
"""Largest number of nodes of a deep tree whose running sums are one product with a matrix.

The product takes a number of additions that is quadratic in the nodes.

Gains: with `SELECTED_ROWS`, hopper's program has a third less to compile.
Seen: de5c15a.
"""
ONE_HOT_PAIRS = 512
"""Largest number of (row, link) pairs for which a sum over links is a product, not a scatter.

Gains: a scatter runs element by element and cannot be part of a section; in time, unknown.
Seen: 626c5cd.
"""
DENSE_DOFS = 64
"""Largest number of degrees of freedom with a dense factor; above it, conjugate gradients.

Gains: unknown.
Seen: 1c78307.
"""
UNROLLED_EVALUATIONS = 8
"""Largest number of evaluations of a line search that is unrolled, which avoids a loop's overhead.

Gains: unknown.
Seen: b322067.
"""
COMPACTED_CONTACTS = 8
"""Contact slots of the smaller solve, which is used while no environment of a batch needs more.

Gains: unknown.
Seen: 303714b.
"""
COMPACTED_IN_KERNEL = 4
"""Contact slots of a still smaller solve, in kernels for CPUs, for a group of 16 environments.

Gains: half_cheetah's step takes 0.8 of its time, ant's and humanoid's 0.87, walker2d's 0.6; their
kernels take 1.2 to 1.6 times as long to compile. Measured on an EPYC with AVX-512.
Seen: 40ba0d6.
"""
COMPACTION_FACTOR = 1.5
"""Least number of contact slots for which a smaller solve repays its compilation, by its slots.

Gains: unknown.
Seen: 303714b.
"""

# --- Chunks of a batch (`parallel.chunks`) ---

VECTOR = 16
"""Numbers in a vector register; lanes of a chunk are a multiple of it, to avoid a remainder loop.

Gains: unknown.
Seen: e8320ea.
"""
CHUNK_UNROLLED = 12288, 64, 128
"""Where XLA may unroll short loops: links that fit in the cache, least and most lanes of a chunk.

Gains: unknown.
Seen: 1619d08.
"""
CHUNK_KEPT = 1536, 32, 64
"""As `CHUNK_UNROLLED`, where `configure_cpu` forbids unrolling; a chunk fits the first-level cache.

Gains: Gymnasium's humanoid takes 0.74 of its time, compilation 0.65. With 32 lanes at least and no
kernel, barkour takes 0.46 of the time with 16, Panda with a box 0.76 to 0.88, five humanoids 0.76
to 1.08, Gymnasium's humanoid 1.04.
Seen: 8f1eea0.
"""

# --- Kernels (`lanes`) ---

KERNEL_SCALARS = 600_000
"""Largest number of scalars in a program that becomes a kernel for CPUs, loops counted once.

A kernel is code for each of them, which a processor's second-level cache should hold. A rollout of
hopper, 49,000, is ready in 2.7 s, where XLA takes 8.8; of a Shadow hand, 510,000, in 25 and 53 s.

Gains: a Shadow hand takes 0.15 of its time, 8 spheres 0.1; five humanoids in one model, a million,
would take twice theirs. Measured on an EPYC with AVX-512.
Seen: bb47929.
"""
GPU_KERNEL_SCALARS = 300_000
"""As `KERNEL_SCALARS`, on a GPU, where the assembler takes long.

Gains: of larger programs, unknown.
Seen: 41faf54.
"""
PULLBACK_SCALARS = 800_000
"""As `KERNEL_SCALARS`, for the derivative of a step in reverse mode.

Hopper's has 115,000, ant's 327,000, that of Gymnasium's humanoid 695,000.

Gains: XLA's derivative takes ten times as long.
Seen: ec5a488.
"""
