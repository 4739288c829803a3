#include "process.h"

int main(int argc, char **argv) {
    return terrapin_process(argc, argv);
}
