#include "buffon_oiio.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/half.h>
#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <vector>

struct BuffonOiioReader {
    /// Only for a file in memory; `input` reads from it, so it is destroyed after `input`.
    std::unique_ptr<OIIO::Filesystem::IOMemReader> memory;
    std::unique_ptr<OIIO::ImageInput> input;
    OIIO::ImageSpec spec;
    std::string part_name;
    int part = 0;
};

struct BuffonOiioBuffer {
    OIIO::Filesystem::IOVecOutput file;
};

namespace {

void say(const std::string &what, char *message, size_t size)
{
    if (!message || !size)
        return;
    size_t length = std::min(what.size(), size - 1);
    std::memcpy(message, what.data(), length);
    message[length] = 0;
}

/// Runs `body`; an exception becomes a message and the return value `failed`.
template <class R, class F>
R guarded(R failed, char *message, size_t size, F &&body) noexcept
{
    try {
        say("", message, size);
        return body();
    } catch (const std::exception &error) {
        try {
            say(error.what(), message, size);
        } catch (...) {
        }
    } catch (...) {
        try {
            say("an exception of unknown type", message, size);
        } catch (...) {
        }
    }
    return failed;
}

int32_t sample_of(OIIO::TypeDesc format)
{
    switch (format.basetype) {
    case OIIO::TypeDesc::FLOAT: return BUFFON_OIIO_SAMPLE_FLOAT;
    case OIIO::TypeDesc::HALF: return BUFFON_OIIO_SAMPLE_HALF;
    case OIIO::TypeDesc::UINT8: return BUFFON_OIIO_SAMPLE_BYTE;
    case OIIO::TypeDesc::UINT16: return BUFFON_OIIO_SAMPLE_SHORT;
    default: return BUFFON_OIIO_SAMPLE_OTHER;
    }
}

OIIO::TypeDesc type_of(int32_t sample)
{
    switch (sample) {
    case BUFFON_OIIO_SAMPLE_HALF: return OIIO::TypeDesc::HALF;
    case BUFFON_OIIO_SAMPLE_BYTE: return OIIO::TypeDesc::UINT8;
    default: return OIIO::TypeDesc::FLOAT;
    }
}

/// The pixels with one type for each channel: the library converts all channels to the same type.
std::vector<unsigned char> pack(const BuffonOiioOutput &o)
{
    std::vector<unsigned char> packed;
    const size_t pixels = size_t(o.width) * size_t(o.height);
    packed.reserve(pixels * size_t(o.channels) * sizeof(float));
    const auto append = [&](const auto &value) {
        const auto *bytes = reinterpret_cast<const unsigned char *>(&value);
        packed.insert(packed.end(), bytes, bytes + sizeof value);
    };
    for (size_t i = 0; i < pixels; ++i) {
        for (int c = 0; c < o.channels; ++c) {
            const float value = o.floats[i * size_t(o.channels) + size_t(c)];
            if (o.samples[c] == BUFFON_OIIO_SAMPLE_HALF)
                append(half(value));
            else
                append(value);
        }
    }
    return packed;
}

void put(OIIO::ImageSpec &spec, const BuffonOiioAttribute &a)
{
    switch (a.kind) {
    case BUFFON_OIIO_INT: spec.attribute(a.name, int(a.integer)); break;
    case BUFFON_OIIO_FLOAT: spec.attribute(a.name, a.number); break;
    case BUFFON_OIIO_TEXT: spec.attribute(a.name, a.text); break;
    case BUFFON_OIIO_MATRIX: spec.attribute(a.name, OIIO::TypeMatrix, a.matrix); break;
    }
}

/// Debian's build prints debug notes on stderr by default.
void be_quiet()
{
    static const bool done = OIIO::attribute("debug", 0);
    (void)done;
}

/// An ImageBuf that wraps the caller's pixels for reading.
OIIO::ImageBuf view(const float *pixels, int32_t width, int32_t height, int32_t channels)
{
    OIIO::ImageSpec spec(width, height, channels, OIIO::TypeFloat);
    return OIIO::ImageBuf(spec, const_cast<float *>(pixels));
}

/// Opens a file, or the reader's memory if it has one.
BuffonOiioReader *open(std::unique_ptr<BuffonOiioReader> reader, const char *path, const char *format,
                       char *message, size_t size)
{
    be_quiet();
    reader->input = OIIO::ImageInput::create(format);
    if (!reader->input) {
        say(OIIO::geterror(), message, size);
        return nullptr;
    }
    if (reader->memory && !reader->input->supports("ioproxy")) {
        say(std::string("files of format ") + format + " cannot be read from memory", message, size);
        return nullptr;
    }
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);
    if (reader->memory) {
        OIIO::Filesystem::IOProxy *proxy = reader->memory.get();
        config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    }
    if (!reader->input->open(path, reader->spec, config)) {
        say(reader->input->geterror(), message, size);
        return nullptr;
    }
    return reader.release();
}

}  // namespace

extern "C" {

int32_t buffon_oiio_version(void) noexcept
{
    return OIIO::openimageio_version();
}

void buffon_oiio_set_threads(int32_t threads) noexcept
{
    guarded(0, nullptr, 0, [&] {
        OIIO::attribute("threads", int(threads));
        OIIO::attribute("exr_threads", int(threads));
        return 1;
    });
}

BuffonOiioReader *buffon_oiio_open(const char *path, const char *format, char *message, size_t size) noexcept
{
    return guarded<BuffonOiioReader *>(nullptr, message, size, [&] {
        return open(std::make_unique<BuffonOiioReader>(), path, format, message, size);
    });
}

BuffonOiioReader *buffon_oiio_open_memory(const unsigned char *bytes, size_t length, const char *format,
                                          char *message, size_t size) noexcept
{
    return guarded<BuffonOiioReader *>(nullptr, message, size, [&] {
        auto reader = std::make_unique<BuffonOiioReader>();
        // The library's pointer is not const, but the memory is only read.
        reader->memory =
            std::make_unique<OIIO::Filesystem::IOMemReader>(const_cast<unsigned char *>(bytes), length);
        const std::string name = std::string("memory.") + format;
        return open(std::move(reader), name.c_str(), format, message, size);
    });
}

void buffon_oiio_close(BuffonOiioReader *reader) noexcept
{
    guarded(0, nullptr, 0, [&] {
        delete reader;
        return 1;
    });
}

int32_t buffon_oiio_part(BuffonOiioReader *reader, int32_t index, BuffonOiioPart *part, char *message,
                         size_t size) noexcept
{
    return guarded(0, message, size, [&] {
        OIIO::ImageSpec spec = reader->input->spec(index, 0);
        if (spec.undefined()) {
            reader->input->geterror();
            return 0;
        }
        reader->spec = spec;
        reader->part = index;
        reader->part_name = spec.get_string_attribute("oiio:subimagename");
        part->width = spec.width;
        part->height = spec.height;
        part->channels = spec.nchannels;
        part->sample = sample_of(spec.format);
        part->deep = spec.deep;
        part->attributes = spec.extra_attribs.size();
        part->name = reader->part_name.c_str();
        return 1;
    });
}

const char *buffon_oiio_channel(const BuffonOiioReader *reader, int32_t channel) noexcept
{
    const auto &names = reader->spec.channelnames;
    return channel >= 0 && size_t(channel) < names.size() ? names[channel].c_str() : nullptr;
}

int32_t buffon_oiio_attribute(const BuffonOiioReader *reader, size_t index, BuffonOiioAttribute *a) noexcept
{
    return guarded(0, nullptr, 0, [&] {
        if (index >= reader->spec.extra_attribs.size())
            return 0;
        const OIIO::ParamValue &value = reader->spec.extra_attribs[int(index)];
        a->name = value.name().c_str();
        if (value.type() == OIIO::TypeInt) {
            a->kind = BUFFON_OIIO_INT;
            a->integer = *static_cast<const int *>(value.data());
        } else if (value.type() == OIIO::TypeFloat) {
            a->kind = BUFFON_OIIO_FLOAT;
            a->number = *static_cast<const float *>(value.data());
        } else if (value.type() == OIIO::TypeString) {
            a->kind = BUFFON_OIIO_TEXT;
            a->text = *static_cast<const char *const *>(value.data());
        } else if (value.type() == OIIO::TypeMatrix) {
            a->kind = BUFFON_OIIO_MATRIX;
            std::memcpy(a->matrix, value.data(), sizeof a->matrix);
        } else {
            return 0;
        }
        return 1;
    });
}

int32_t buffon_oiio_read(BuffonOiioReader *reader, float *pixels, size_t count, char *message,
                         size_t size) noexcept
{
    return guarded(0, message, size, [&] {
        const OIIO::ImageSpec &spec = reader->spec;
        const size_t area = size_t(spec.width) * size_t(spec.height), stride = size_t(spec.nchannels);
        if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || area * stride != count) {
            say("the buffer does not fit the image", message, size);
            return 0;
        }
        if (!reader->input->read_image(reader->part, 0, 0, spec.nchannels, OIIO::TypeFloat, pixels)) {
            say(reader->input->geterror(), message, size);
            return 0;
        }
        // The library converts integers to fractions of 2^32 - 1, so these channels are read in their own type.
        std::vector<uint32_t> integers;
        for (int c = 0; c < spec.nchannels; ++c) {
            if (spec.channelformat(c).basetype != OIIO::TypeDesc::UINT32)
                continue;
            integers.resize(area);
            if (!reader->input->read_image(reader->part, 0, c, c + 1, OIIO::TypeUInt, integers.data())) {
                say(reader->input->geterror(), message, size);
                return 0;
            }
            for (size_t i = 0; i < area; ++i)
                pixels[i * stride + size_t(c)] = float(integers[i]);
        }
        return 1;
    });
}

int32_t buffon_oiio_read_codes(BuffonOiioReader *reader, int32_t sample, void *pixels, size_t count, char *message,
                               size_t size) noexcept
{
    return guarded(0, message, size, [&] {
        const OIIO::ImageSpec &spec = reader->spec;
        const size_t area = size_t(spec.width) * size_t(spec.height), stride = size_t(spec.nchannels);
        if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || area * stride != count) {
            say("the buffer does not fit the image", message, size);
            return 0;
        }
        if (sample != sample_of(spec.format)) {
            say("the samples are of another type", message, size);
            return 0;
        }
        const OIIO::TypeDesc type = sample == BUFFON_OIIO_SAMPLE_SHORT ? OIIO::TypeUInt16 : OIIO::TypeUInt8;
        if (!reader->input->read_image(reader->part, 0, 0, spec.nchannels, type, pixels)) {
            say(reader->input->geterror(), message, size);
            return 0;
        }
        return 1;
    });
}

BuffonOiioBuffer *buffon_oiio_encode(const BuffonOiioOutput *o, char *message, size_t size) noexcept
{
    return guarded<BuffonOiioBuffer *>(nullptr, message, size, [&]() -> BuffonOiioBuffer * {
        auto buffer = std::make_unique<BuffonOiioBuffer>();
        be_quiet();
        std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(o->format);
        if (!output) {
            say(OIIO::geterror(), message, size);
            return nullptr;
        }
        OIIO::ImageSpec spec(o->width, o->height, o->channels, type_of(o->samples[0]));
        const bool mixed = std::any_of(o->samples, o->samples + o->channels,
                                       [&](int32_t sample) { return sample != o->samples[0]; });
        spec.alpha_channel = -1;
        for (int c = 0; c < o->channels; ++c) {
            if (mixed)
                spec.channelformats.push_back(type_of(o->samples[c]));
            spec.channelnames[c] = o->channel_names[c];
            if (spec.channelnames[c] == "A")
                spec.alpha_channel = c;
        }
        spec.attribute("compression", o->compression);
        spec.attribute("oiio:UnassociatedAlpha", o->bytes ? 1 : 0);
        // Without a date the OpenEXR writer stores the current time, and equal images would give different files. A
        // date of a type that cannot be written is omitted.
        const uint8_t no_date = 0;
        spec.attribute("DateTime", OIIO::TypeUInt8, &no_date);
        for (size_t i = 0; i < o->attribute_count; ++i)
            put(spec, o->attributes[i]);
        OIIO::TypeDesc type = o->bytes ? OIIO::TypeUInt8 : OIIO::TypeFloat;
        const void *data = o->bytes ? static_cast<const void *>(o->bytes) : o->floats;
        std::vector<unsigned char> packed;
        if (mixed) {
            packed = pack(*o);
            type = OIIO::TypeUnknown;  // the types of the channels
            data = packed.data();
        }
        // Unused: no file of this name is opened.
        const std::string name = std::string("memory.") + o->format;
        if (!output->set_ioproxy(&buffer->file) || !output->open(name, spec) || !output->write_image(type, data)
            || !output->close()) {
            say(output->geterror(), message, size);
            return nullptr;
        }
        return buffer.release();
    });
}

const uint8_t *buffon_oiio_bytes(const BuffonOiioBuffer *buffer, size_t *size) noexcept
{
    const std::vector<unsigned char> &bytes = buffer->file.buffer();
    *size = bytes.size();
    return bytes.data();
}

void buffon_oiio_free(BuffonOiioBuffer *buffer) noexcept
{
    guarded(0, nullptr, 0, [&] {
        delete buffer;
        return 1;
    });
}

int32_t buffon_oiio_compare(const float *a, const float *b, int32_t width, int32_t height, int32_t channels,
                            BuffonOiioDifference *difference, char *message, size_t size) noexcept
{
    return guarded(0, message, size, [&] {
        OIIO::ImageBuf first = view(a, width, height, channels), second = view(b, width, height, channels);
        OIIO::ImageBufAlgo::CompareResults found = OIIO::ImageBufAlgo::compare(first, second, 0.0f, 0.0f);
        if (first.has_error() || second.has_error()) {
            say(first.has_error() ? first.geterror() : second.geterror(), message, size);
            return 0;
        }
        *difference = { found.meanerror, found.rms_error, found.PSNR, found.maxerror,
                        found.maxx,      found.maxy,      found.maxc };
        return 1;
    });
}

}  // extern "C"
