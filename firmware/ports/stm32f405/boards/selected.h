/* The board that this image is built for: CMake names its header. */
#ifndef TERRAPIN_BOARD_SELECTED_H
#define TERRAPIN_BOARD_SELECTED_H

#include TERRAPIN_BOARD

#endif
