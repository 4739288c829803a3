/* The board that this image is built for: CMake names its header, that of the robot's board or the emulated one. */
#ifndef TERRAPIN_BOARD_SELECTED_H
#define TERRAPIN_BOARD_SELECTED_H

#include TERRAPIN_BOARD

#endif
