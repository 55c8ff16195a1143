/*
 * thermal_bias: dynamic thermal bias, corrected sample by sample. Made by thermocorr 0.1.0 (Python 3.11.7, numpy 2.4.6); do not edit.
 *
 * Reading: reading [ppm], mean 258.2153576
 * Fitted readings: 5000
 * Temperature: temperature, fitted from 21.8456 to 24.5983
 * U0, reading at the reference temperature 23.32679219: 258.27213233913437
 * Fitted rows: 5000, from 2024-03-04 00:00:00 to 2024-03-07 11:19:00
 * Their usual step: 60 s
 * Time constants: 30, 168.622, 467.856, 1298.11, 2563.16, 5061.06 s
 * Standard deviation of the fitted residuals: 0.200505
 * Effects removed: static polynomial; thermal lag; initial transient
 * Effects kept in the corrected reading: none
 * Time between samples: 60 s, fixed
 * State after init: unknown, taken to be at rest
 * Flagged after it, while the lags forget: 15183.2 s
 */
#ifndef THERMAL_BIAS_H
#define THERMAL_BIAS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define THERMAL_BIAS_NO_TEMPERATURE 1u /* temperature missing or absurd: the last good one was taken */
#define THERMAL_BIAS_NO_READING 4u /* reading missing or not finite: no corrected reading */
#define THERMAL_BIAS_WASHOUT 8u /* the lags have not yet forgotten an unknown start */
#define THERMAL_BIAS_OUTSIDE_RANGE 16u /* temperature outside the fitted range: the bias is extrapolated */
#define THERMAL_BIAS_NOT_STARTED 32u /* no sample with all inputs yet: nothing is corrected */

typedef struct {
    float temperature; /* at the last sample */
    float lag[6]; /* T: tau = 30, 168.622, 467.856, 1298.11, 2563.16, 5061.06 s [K] */
    float rest_slow[3]; /* what rounding took from lag */
    uint32_t settling; /* samples until the start is forgotten */
    uint32_t started; /* 0 until the first usable sample */
} thermal_bias_state;

#define THERMAL_BIAS_STATE_BYTES 48u
#define THERMAL_BIAS_PERIOD_S 60.0f /* between samples */

typedef struct {
    float bias;      /* what temperature and the other causes add to the reading, its unit */
    float corrected; /* reading - bias, eq. (24) */
    uint32_t flags; /* why the result deserves no trust; 0: it does */
} thermal_bias_result;

/* Call init once, then update for every sample, also where an input is missing (NaN): its last good value
 * stands in. After a long outage, or when the device was moved, call init again. */
void thermal_bias_init(thermal_bias_state *s);

thermal_bias_result thermal_bias_update(thermal_bias_state *s, float temperature, float reading);

#ifdef __cplusplus
}
#endif

#endif
