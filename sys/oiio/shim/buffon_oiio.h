/* A C interface to what Buffon uses of OpenImageIO. No C++ type, exception or allocation crosses it:
 * buffers belong to the caller, strings of a reader live as long as the reader.
 *
 * Functions that can fail return 1 on success and 0 on failure, and then leave a message, ended by a
 * NUL and cut to fit, in `message`. Pixels are row-major, channels interleaved, the top row first. */
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

/* How samples are stored in the file. */
#define BUFFON_OIIO_SAMPLE_FLOAT 0
#define BUFFON_OIIO_SAMPLE_HALF 1
#define BUFFON_OIIO_SAMPLE_BYTE 2
#define BUFFON_OIIO_SAMPLE_SHORT 3
#define BUFFON_OIIO_SAMPLE_OTHER 4

/* A named metadata value; the member that `kind` names is valid. */
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

/* What a part of a file holds. */
typedef struct BuffonOiioPart {
    int32_t width;
    int32_t height;
    int32_t channels;
    int32_t sample;
    int32_t deep;
    size_t attributes;
    const char *name;
} BuffonOiioPart;

/* What to write; `format` is OpenImageIO's name of the format, `samples` says how each channel is stored. Bytes are
   stored as bytes; floats as floats and halves. */
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

/* The differences of two images, as ImageBufAlgo::compare gives them. */
typedef struct BuffonOiioDifference {
    double mean;
    double rms;
    double psnr;
    double max;
    int32_t x;
    int32_t y;
    int32_t channel;
} BuffonOiioDifference;

/* The version of the library in use, 10000 * major + 100 * minor + patch. */
int32_t buffon_oiio_version(void) BUFFON_OIIO_NOEXCEPT;

/* Limits the library's threads, its own and OpenEXR's; 0 = as many as there are cores. */
void buffon_oiio_set_threads(int32_t threads) BUFFON_OIIO_NOEXCEPT;

/* Opens `path` as `format`; NULL on failure. */
BuffonOiioReader *buffon_oiio_open(const char *path, const char *format, char *message,
                                   size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Opens `size` bytes, which must outlive the reader and are only read, as `format`; NULL on failure. */
BuffonOiioReader *buffon_oiio_open_memory(const unsigned char *bytes, size_t size, const char *format,
                                          char *message, size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Closes and frees a reader; NULL is allowed. */
void buffon_oiio_close(BuffonOiioReader *reader) BUFFON_OIIO_NOEXCEPT;

/* Goes to a part of the file. 0 when there is no such part (the message is then empty) or on failure. */
int32_t buffon_oiio_part(BuffonOiioReader *reader, int32_t index, BuffonOiioPart *part, char *message,
                         size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* The name of a channel of the current part; NULL when there is none such. */
const char *buffon_oiio_channel(const BuffonOiioReader *reader, int32_t channel) BUFFON_OIIO_NOEXCEPT;

/* A metadata value of the current part; 0 when it has another type or when there is none such. */
int32_t buffon_oiio_attribute(const BuffonOiioReader *reader, size_t index,
                              BuffonOiioAttribute *attribute) BUFFON_OIIO_NOEXCEPT;

/* Reads the current part's pixels into `pixels`, which holds `count` = width * height * channels floats. */
int32_t buffon_oiio_read(BuffonOiioReader *reader, float *pixels, size_t count, char *message,
                         size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Reads the current part's samples as the integers that they are, into `pixels` for `count` = width * height * channels
 * of them: uint8_t for BUFFON_OIIO_SAMPLE_BYTE, uint16_t for BUFFON_OIIO_SAMPLE_SHORT. */
int32_t buffon_oiio_read_codes(BuffonOiioReader *reader, int32_t sample, void *pixels, size_t count, char *message,
                               size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* Encodes a file in memory; NULL on failure. Not on disk, because the library's writers do not all notice
 * when that is full: PNG says nothing and JPEG ends the process. */
BuffonOiioBuffer *buffon_oiio_encode(const BuffonOiioOutput *output, char *message,
                                     size_t message_size) BUFFON_OIIO_NOEXCEPT;

/* The bytes of an encoded file and, in `size`, how many there are. */
const uint8_t *buffon_oiio_bytes(const BuffonOiioBuffer *buffer, size_t *size) BUFFON_OIIO_NOEXCEPT;

/* Frees an encoded file; NULL is allowed. */
void buffon_oiio_free(BuffonOiioBuffer *buffer) BUFFON_OIIO_NOEXCEPT;

/* Compares two images of the same shape. A NaN that meets a NaN counts as equal. */
int32_t buffon_oiio_compare(const float *a, const float *b, int32_t width, int32_t height, int32_t channels,
                            BuffonOiioDifference *difference, char *message,
                            size_t message_size) BUFFON_OIIO_NOEXCEPT;

#ifdef __cplusplus
}
#endif

#endif
