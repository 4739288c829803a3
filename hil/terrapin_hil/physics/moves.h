/* How values move along directions, to first order: of the states of a law, and of the tables of a run's neighbours.
 * What program.h does to values is done to their moves, by the exact derivatives of its formulas.
 */
#ifndef HIL_MOVES_H
#define HIL_MOVES_H

#include "program.h"

enum { HIL_MOVES_SLOTS = 160, HIL_MOVES_WIDTH = 76 };

/* `width` directions: `states`, then a column for each neighbour. A slot that some direction moves has a row: its
 * derivatives by the states, and what its value is more at each neighbour. */
typedef struct {
    int states;
    int width;
    int base;                   /* rows of the tables */
    int rows;                   /* in use */
    int first[HIL_MOVES_SLOTS]; /* of a slot, its row of the tables; -1: none */
    int row[HIL_MOVES_SLOTS];   /* as it is now */
    double by[2 * HIL_MOVES_SLOTS][HIL_MOVES_WIDTH];
} hil_moves;

/* From `values`: `count` slots (at most HIL_MOVES_SLOTS) of the run, and of each of `columns` neighbours after it. */
void hil_moves_begin(hil_moves *moves, int states, int columns, int count, const double *values);

/* A slot that has the same value in all tables after all: an input. */
void hil_moves_hold(hil_moves *moves, int slot);

/* Forgets all but the tables: what formulas and the states have moved. */
void hil_moves_again(hil_moves *moves);

/* A new row for a slot, of zeros (width), to be filled. */
double *hil_moves_row(hil_moves *moves, int slot);

/* sum (width) += times the row of a slot, if it has one. */
void hil_moves_add(const hil_moves *moves, int slot, double times, double *sum);

/* As hil_additions_change, and the moves of what it changes. */
void hil_moves_change(const hil_additions *additions, int ground, double *values, hil_moves *moves);

/* As hil_additions_torque; torque_by and inertia_by (width) receive the moves of both. */
double hil_moves_torque(const hil_additions *additions, int ground, double *values, const hil_moves *moves,
                        double *inertia, double *torque_by, double *inertia_by);

#endif
