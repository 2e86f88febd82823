/* Where data lie in a netCDF file of the classic formats (CDF-1, -2, -5). libnetcdf tells nobody,
 * and reads zeros where such a file was cut. */
#ifndef METANODE_NETCDF_CLASSIC_H
#define METANODE_NETCDF_CLASSIC_H

#include <stdint.h>

/* Bytes that the file must have for the variable (libnetcdf's number) to be all there. 0: the file
 * is none of these formats, which is for others to check. UINT64_MAX: its header cannot be read, or
 * the variable grows by records. */
uint64_t classic_end(const char *path, int variable);

#endif
