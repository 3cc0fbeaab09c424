# Object Files for users: queries, the shell command for one object, and notebooks of the package.
#   docker build -t objectfolder . && docker run --rm -v "$PWD:/work" objectfolder modes mug.safetensors
# Making a data set needs the whole environment: `make environment` on Debian or Ubuntu.
FROM python:3.12-slim-bookworm

COPY pyproject.toml README.md LICENSE /source/
COPY objectfolder /source/objectfolder
COPY pipeline /source/pipeline
COPY data /source/data
RUN pip install --no-cache-dir /source Jinja2 matplotlib pandas && rm -rf /source \
    && useradd --create-home user && mkdir /work && chown user /work

USER user
WORKDIR /work
ENTRYPOINT ["objectfolder"]
CMD ["--help"]
