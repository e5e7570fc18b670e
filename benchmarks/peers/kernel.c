/* Drifts and kicks of q'' = -k (1 - 1/|q|) q - gamma e_y for many lanes in blocks of 64.

scheme.h, written by c_kernel.py, defines FIRST, the first drift, and SCHEME, a STAGE(kick, drift) for each stage with
the last drift joined to the next step's first.  REAL is double or float.

With AVX-512 a group of VECTORS registers of lanes goes through all steps without touching memory, and 1/|q| is the
machine's estimate of 14 bits sharpened by a step of third order and, in double, a step of second; elsewhere, or with
LOOPS defined, loops over the 64 lanes of a block are left to the compiler. */

#include <math.h>
#include "scheme.h"

#define BLOCK 64
#define ATTRIBUTES static inline __attribute__((always_inline))
typedef REAL real;

#if defined(__AVX512F__) && !defined(LOOPS)

#include <immintrin.h>

typedef real vec __attribute__((vector_size(64), aligned(8), may_alias));
#define WIDTH (64 / (int)sizeof(real))
#define VECTORS 4
#define GROUP (WIDTH * VECTORS)

ATTRIBUTES vec inverse_root(vec s)
{
    if (sizeof(real) == 4) {
        vec y = (vec)_mm512_rsqrt14_ps((__m512)s);
        return y + y * ((real)0.5 - (real)0.5 * s * y * y);
    }
    vec y = (vec)_mm512_rsqrt14_pd((__m512d)s);
    vec e = 1 - s * y * y;
    y = y + y * e * ((real)0.5 + (real)0.375 * e);
    return y + (real)0.5 * y * (1 - s * y * y);
}

#define EACH _Pragma("GCC unroll 4") for (int i = 0; i < VECTORS; i++)
#define STAGE(KICK, DRIFT)                                                     \
    EACH {                                                                     \
        vec f = ((real)(KICK) * hk) * inverse_root(x[i] * x[i] + y[i] * y[i]) - (real)(KICK) * hk; \
        u[i] += f * x[i];                                                      \
        v[i] += f * y[i] - (real)(KICK) * hg;                                  \
        x[i] += ((real)(DRIFT) * h) * u[i];                                    \
        y[i] += ((real)(DRIFT) * h) * v[i];                                    \
    }

__attribute__((noinline)) void hot(long steps, real h, real k, real gamma, real *X, real *Y, real *U, real *V)
{
    real hk = h * k, hg = h * gamma;
    for (int group = 0; group < BLOCK; group += GROUP) {
        vec x[VECTORS], y[VECTORS], u[VECTORS], v[VECTORS];
        EACH {
            int at = group + i * WIDTH;
            x[i] = *(vec *)(X + at), y[i] = *(vec *)(Y + at), u[i] = *(vec *)(U + at), v[i] = *(vec *)(V + at);
            x[i] += ((real)FIRST * h) * u[i], y[i] += ((real)FIRST * h) * v[i];
        }
        for (long n = 0; n < steps; n++) {
            SCHEME
        }
        EACH {
            int at = group + i * WIDTH;
            x[i] -= ((real)FIRST * h) * u[i], y[i] -= ((real)FIRST * h) * v[i];
            *(vec *)(X + at) = x[i], *(vec *)(Y + at) = y[i], *(vec *)(U + at) = u[i], *(vec *)(V + at) = v[i];
        }
    }
}

#else

ATTRIBUTES real inverse_root(real s) { return sizeof(real) == 4 ? (real)(1 / sqrtf((float)s)) : (real)(1 / sqrt(s)); }

#define EACH _Pragma("omp simd") for (int i = 0; i < BLOCK; i++)
#define STAGE(KICK, DRIFT)                                                     \
    EACH {                                                                     \
        real f = ((real)(KICK) * hk) * inverse_root(x[i] * x[i] + y[i] * y[i]) - (real)(KICK) * hk; \
        u[i] += f * x[i];                                                      \
        v[i] += f * y[i] - (real)(KICK) * hg;                                  \
        x[i] += ((real)(DRIFT) * h) * u[i];                                    \
        y[i] += ((real)(DRIFT) * h) * v[i];                                    \
    }

__attribute__((noinline)) void hot(long steps, real h, real k, real gamma, real *X, real *Y, real *U, real *V)
{
    real hk = h * k, hg = h * gamma;
    real x[BLOCK] __attribute__((aligned(64))), y[BLOCK] __attribute__((aligned(64)));
    real u[BLOCK] __attribute__((aligned(64))), v[BLOCK] __attribute__((aligned(64)));
    EACH { u[i] = U[i], v[i] = V[i], x[i] = X[i] + (real)FIRST * h * u[i], y[i] = Y[i] + (real)FIRST * h * v[i]; }
    for (long n = 0; n < steps; n++) {
        SCHEME
    }
    EACH { U[i] = u[i], V[i] = v[i], X[i] = x[i] - (real)FIRST * h * u[i], Y[i] = y[i] - (real)FIRST * h * v[i]; }
}

#endif

void run(long blocks, int threads, long steps, double h, double k, double gamma, real *X, real *Y, real *U, real *V)
{
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
    for (long block = 0; block < blocks; block++) {
        long at = block * BLOCK;
        hot(steps, (real)h, (real)k, (real)gamma, X + at, Y + at, U + at, V + at);
    }
}
