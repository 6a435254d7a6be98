# steelyard on Debian's image of Python: docker build -t steelyard . && docker run --rm -v "$PWD:/data" steelyard demo
FROM python:3.13-slim-bookworm
COPY . /source
RUN pip install --no-cache-dir '/source[all,live]' && rm -r /source
WORKDIR /data
ENTRYPOINT ["steelyard"]
