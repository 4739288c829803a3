/* Where a sphere rolls on the plane whose inner device is steered: heading and path.
 *
 * The drive wheel runs at the shell's lowest point and is steered about the vertical (the Spherical Mobile Robot of
 * which Reina et al. 2006 is the one-directional case). No slip inside and no spinning of the shell about the vertical:
 * the shell then rolls in the plane of the wheel, so the heading is the steering angle and may change on the spot.
 * Sideways the contact holds [our assumption: v psi' stays below what the ground carries, mu g].
 *
 *     x' = v cos psi,  y' = v sin psi
 */
#ifndef HIL_HEADING_H
#define HIL_HEADING_H

/* Moves path[2] [m] by `travelled` [m] while the heading turns evenly from `from` to `to` [rad]: a circle's arc, exact.
 */
void hil_heading_advance(double travelled, double from, double to, double *path);

#endif
