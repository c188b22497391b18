/* Temperature and force of units with a calibration each, float32: the arithmetic alone.
 * Blocks of LANES units; rows of a block lie one after the other. */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { LANES = 16 };
enum {
    GEL_SCALE, GEL_OFFSET, GEL_OCTAVE, DEPTH_SCALE, DEPTH_OFFSET, SOFT, BREAK, STIFFER,
    X_BX, X_BY, X_OFFSET, Y_BX, Y_BY, Y_OFFSET, CHIP_SCALE, CHIP_OFFSET, FILM_SCALE, FILM_OFFSET,
    GROWTH, OCTAVES, REACH, SHEAR_SOFT, SHEAR_BREAK, SHEAR_STIFFER, ROWS
};

static inline float of_bits(int32_t i) { float f; memcpy(&f, &i, 4); return f; }
static inline int32_t bits_of(float f) { int32_t i; memcpy(&i, &f, 4); return i; }

static inline float log2_(float x) {
    int32_t bits = bits_of(x), exponent = (bits - 0x3F3504F3) >> 23;
    float f = of_bits(bits - (int32_t)((uint32_t)exponent << 23)) - 1.0f;
    float p = -0.14581172f;
    p = p * f + 0.23404236f;
    p = p * f - 0.24887685f;
    p = p * f + 0.28709870f;
    p = p * f - 0.36023964f;
    p = p * f + 0.48092324f;
    p = p * f - 0.72135279f;
    p = p * f + 1.4426950f;
    return (float)exponent + f * p;
}

static inline float exp2_(float x) {
    float whole = floorf(x + 0.5f), f = x - whole;
    float p = 0.0013276472f;
    p = p * f + 0.0096755413f;
    p = p * f + 0.055507133f;
    p = p * f + 0.24022120f;
    p = p * f + 0.69314697f;
    p = p * f + 1.0f;
    return p * of_bits((int32_t)((uint32_t)((int32_t)whole + 127) << 23));
}

static inline float asin_(float x) {
    int large = x > 0.5f;
    float half = (1.0f - x) * 0.5f, z = large ? half : x * x, s = large ? sqrtf(half) : x;
    float p = 0.0421663783f;
    p = p * z + 0.0241794679f;
    p = p * z + 0.0454703867f;
    p = p * z + 0.0749529749f;
    p = p * z + 0.166667521f;
    float r = s + s * (z * p);
    return large ? 1.57079633f - (r + r) : r;
}

void bare(int64_t n, const int16_t *restrict counts, const float *restrict coefficients,
          float *restrict out) {
    const int16_t *gel = counts, *frequency = gel + n, *bx = frequency + n, *by = bx + n,
                  *chip = by + 2 * n;
    for (int64_t block = 0; block < n / LANES; block++) {
        const float *c = coefficients + block * ROWS * LANES;
#define C(row) c[(row) * LANES + lane]
#pragma GCC ivdep
        for (int lane = 0; lane < LANES; lane++) {
            int64_t i = block * LANES + lane;
            float t = 20.0f + C(GEL_OCTAVE) * log2_(C(GEL_SCALE) * gel[i] + C(GEL_OFFSET));
            float depth = C(DEPTH_SCALE) * frequency[i] + C(DEPTH_OFFSET);
            float x = C(X_BX) * bx[i] + C(X_BY) * by[i] + C(X_OFFSET);
            float y = C(Y_BX) * bx[i] + C(Y_BY) * by[i] + C(Y_OFFSET);
            float gain = (C(CHIP_SCALE) * chip[i] + C(CHIP_OFFSET))
                         * (C(FILM_SCALE) * t + C(FILM_OFFSET));
            float square = fmaxf(x * x + y * y, 1e-12f), each = 1.0f / sqrtf(square);
            float inverse = exp2_(C(GROWTH) * depth + C(OCTAVES));
            float ratio = fminf(square * each * inverse / gain, 1.0f);
            float reach = C(REACH) * asin_(ratio);
            float force = C(SHEAR_SOFT) * reach
                          + C(SHEAR_STIFFER) * fmaxf(reach - C(SHEAR_BREAK), 0.0f);
            force *= each;
            out[i] = t;
            out[n + i] = force * x;
            out[2 * n + i] = force * y;
            out[3 * n + i] = C(SOFT) * depth + C(STIFFER) * fmaxf(depth - C(BREAK), 0.0f);
        }
    }
}
