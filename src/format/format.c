#include "block.h"
typedef int mni_empty_unit;
