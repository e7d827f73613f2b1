/* A C interface to the part of OpenImageIO that Buffon uses. No C++ type, exception or allocation crosses it:
 * buffers belong to the caller, and strings of a reader live as long as the reader.
 *
 * Functions that can fail return 1 on success and 0 on failure. On failure they store a message in `message`,
 * terminated by a NUL and truncated to fit. Pixels are row-major with interleaved channels, the top row first. */
#ifndef BUFFON_OIIO_H
#define BUFFON_OIIO_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define BUFFON_OIIO_NOEXCEPT noexcept
#else
#define BUFFON_OIIO_NOEXCEPT
#endif

/* The type of a metadata value. */
#define BUFFON_OIIO_INT 0
#define BUFFON_OIIO_FLOAT 1
#define BUFFON_OIIO_TEXT 2
#define BUFFON_OIIO_MATRIX 3

/* The type of a sample in the file. */
#define BUFFON_OIIO_SAMPLE_FLOAT 0
#define BUFFON_OIIO_SAMPLE_HALF 1
#define BUFFON_OIIO_SAMPLE_BYTE 2
#define BUFFON_OIIO_SAMPLE_SHORT 3
#define BUFFON_OIIO_SAMPLE_OTHER 4

/* A named metadata value. Only the member selected by `kind` is valid. */
typedef struct BuffonOiioAttribute {
    const char *name;
    int32_t kind;
    int32_t integer;
    float number;
    const char *text;
    float matrix[16];
} BuffonOiioAttribute;

/* An image file that is open for reading. */
typedef struct BuffonOiioReader BuffonOiioReader;

/* An encoded file in memory. */
typedef struct BuffonOiioBuffer BuffonOiioBuffer;

/* The description of one part of a file. */
typedef struct BuffonOiioPart {
    int32_t width;
    int32_t height;
    int32_t channels;
    int32_t sample;
    int32_t deep;
    size_t attributes;
    const char *name;
} BuffonOiioPart;

/* The image to write. `format` is OpenImageIO's name of the format; `samples` is the stored type of each channel.
   Bytes are stored as bytes; floats as floats or halves. */
typedef struct BuffonOiioOutput {
    const char *format;
    int32_t width;
    int32_t height;
    int32_t channels;
    const int32_t *samples;
    const char *const *channel_names;
    const float *floats;
    const uint8_t *bytes;
    const char *compression;
    const BuffonOiioAttribute *attributes;
    size_t attribute_count;
} BuffonOiioOutput;

/* The differences of two images, as computed by ImageBufAlgo::compare. */
typedef struct BuffonOiioDifference {
    double mean;
    double rms;
    double psnr;
    double max;
    int32_t x;
    int32_t y;
    int32_t channel;
} BuffonOiioDifference;

/* Returns the version of the library in use, 10000 * major + 100 * minor + patch. */
int32_t buffon_oiio_version(void) BUFFON_OIIO_NOEXCEPT;

/* Limits the number of threads of the library and of OpenEXR; 0 = the number of cores. */
void buffon_oiio_set_threads(int32_t threads) BUFFON_OIIO_NOEXCEPT;

/* Opens `path` as `format`. Returns NULL on failure. */
BuffonOiioReader *buffon_oiio_open(const char *path, const char *format, char *message,
                                   size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Opens `size` bytes as `format`. They are only read and must outlive the reader. Returns NULL on failure. */
BuffonOiioReader *buffon_oiio_open_memory(const unsigned char *bytes, size_t size, const char *format,
                                          char *message, size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Closes and frees a reader; NULL is allowed. */
void buffon_oiio_close(BuffonOiioReader *reader) BUFFON_OIIO_NOEXCEPT;

/* Selects a part of the file. Returns 0 if there is no such part (the message is then empty) or on failure. */
int32_t buffon_oiio_part(BuffonOiioReader *reader, int32_t index, BuffonOiioPart *part, char *message,
                         size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Returns the name of a channel of the current part, or NULL if there is no such channel. */
const char *buffon_oiio_channel(const BuffonOiioReader *reader, int32_t channel) BUFFON_OIIO_NOEXCEPT;

/* Reads a metadata value of the current part. Returns 0 if its type is not supported or if there is no such value. */
int32_t buffon_oiio_attribute(const BuffonOiioReader *reader, size_t index,
                              BuffonOiioAttribute *attribute) BUFFON_OIIO_NOEXCEPT;

/* Reads the current part's pixels into `pixels`, which holds `count` = width * height * channels floats. */
int32_t buffon_oiio_read(BuffonOiioReader *reader, float *pixels, size_t count, char *message,
                         size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Reads the current part's samples as integers, without conversion, into `pixels`, which holds `count` =
 * width * height * channels of them: uint8_t for BUFFON_OIIO_SAMPLE_BYTE, uint16_t for BUFFON_OIIO_SAMPLE_SHORT. */
int32_t buffon_oiio_read_codes(BuffonOiioReader *reader, int32_t sample, void *pixels, size_t count, char *message,
                               size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Encodes a file in memory. Returns NULL on failure. It does not write to disk, because not all of the library's
 * writers handle a full disk: PNG reports no error and JPEG ends the process. */
BuffonOiioBuffer *buffon_oiio_encode(const BuffonOiioOutput *output, char *message,
                                     size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Returns the bytes of an encoded file and stores their number in `size`. */
const uint8_t *buffon_oiio_bytes(const BuffonOiioBuffer *buffer, size_t *size) BUFFON_OIIO_NOEXCEPT;

/* Frees an encoded file; NULL is allowed. */
void buffon_oiio_free(BuffonOiioBuffer *buffer) BUFFON_OIIO_NOEXCEPT;

/* Compares two images of the same shape. Two NaN at the same position are equal. */
int32_t buffon_oiio_compare(const float *a, const float *b, int32_t width, int32_t height, int32_t channels,
                            BuffonOiioDifference *difference, char *message,
                            size_t message_size) BUFFON_OIIO_NOEXCEPT;

#ifdef __cplusplus
}
#endif

#endif
