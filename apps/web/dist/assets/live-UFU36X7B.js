import{a,b,c}from"./chunk-PF5JW45N.js";import"./chunk-4P7KZJ57.js";import"./chunk-RE6JOP7L.js";export{c as Live,b as LiveFigures,a as WALL};
