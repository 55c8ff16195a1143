/* Made by thermocorr; see thermal_bias.h. */
#include "thermal_bias.h"

#include <float.h>

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
#error Roundings are carried on and missing inputs told by comparisons: build without fast mathematics
#endif

static const float near_t0 = 23.3267918f; /* a usual value of T */
static const float loss_fast[3] = { /* 1 - exp(-dt/tau) */
    0.864664733f, 0.299405247f, 0.12036179f
};
static const float gain_fast[3] = { /* (1 - exp(-dt/tau)) tau/dt */
    0.432332367f, 0.841438055f, 0.938533127f
};
static const float loss_slow[3] = { /* 1 - exp(-dt/tau) */
    0.0451692268f, 0.0231367368f, 0.0117852287f
};
static const float gain_slow[3] = { /* (1 - exp(-dt/tau)) tau/dt */
    0.977241397f, 0.988386512f, 0.994095743f
};
static const float weight = 0.000127948297f; /* ppm/(K K), of T * T */
static const float weight_2 = 9.99534225f; /* ppm/K, of T */
static const float weight_3[6] = { /* ppm/K, of lag of T, 30 s */
    -1.40541589f, 5.12371159f, 3.74553776f, -0.731715441f,
    0.165512607f, 2.24989104f
};
static const float bias_at_reference = -4.24812333e-06f; /* sum of all constant terms */

static int is_within(float value, float limit)
{
    return value >= -limit && value <= limit; /* false for NaN */
}

void thermal_bias_init(thermal_bias_state *s)
{
    s->temperature = 0.0f;
    for (int j = 0; j < 6; ++j) {
        s->lag[j] = 0.0f;
    }
    for (int j = 0; j < 3; ++j) {
        s->rest_slow[j] = 0.0f;
    }
    s->settling = 0;
    s->started = 0;
}

thermal_bias_result thermal_bias_update(thermal_bias_state *s, float temperature, float reading)
{
    thermal_bias_result result;
    float bias = bias_at_reference;

    result.flags = 0;
    if (!is_within(temperature, 2780.0f)) {
        result.flags |= THERMAL_BIAS_NO_TEMPERATURE;
        temperature = s->temperature;
    }
    if (!is_within(reading, FLT_MAX)) {
        result.flags |= THERMAL_BIAS_NO_READING;
    }

    const int first = s->started == 0;
    if (s->started == 0) {
        if ((result.flags & THERMAL_BIAS_NO_TEMPERATURE) != 0) {
            result.flags |= THERMAL_BIAS_NOT_STARTED;
            result.bias = 0.0f;
            result.corrected = reading;
            return result;
        }
        s->started = 1;
        s->temperature = temperature;
    }

    const float deviation = temperature - near_t0;
    const float change = temperature - s->temperature;
    if (first) {
        s->settling = UINT32_C(254);
    } else {
        for (int j = 0; j < 3; ++j) {
            s->lag[j] -= loss_fast[j] * s->lag[j] + gain_fast[j] * change; /* eq. (25) */
        }
        for (int j = 0; j < 3; ++j) {
            const float increment = s->rest_slow[j] + loss_slow[j] * s->lag[j + 3] + gain_slow[j] * change; /* eq. (25) */
            const float next = s->lag[j + 3] - increment;
            s->rest_slow[j] = (next - s->lag[j + 3]) + increment;
            s->lag[j + 3] = next;
        }
    }

    bias += deviation * (weight * deviation + weight_2);
    for (int j = 0; j < 6; ++j) {
        bias += weight_3[j] * s->lag[j];
    }

    if (temperature < 21.845644f || temperature > 24.5982914f) {
        result.flags |= THERMAL_BIAS_OUTSIDE_RANGE;
    }
    if (s->settling > 0) {
        --s->settling;
        result.flags |= THERMAL_BIAS_WASHOUT;
    }
    s->temperature = temperature;
    result.bias = bias;
    result.corrected = reading - bias;
    return result;
}
