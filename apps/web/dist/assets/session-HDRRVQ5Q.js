import"./chunk-A7OK6EBF.js";import{o as e,v as i}from"./chunk-E6BSTD65.js";function o(){return e(i,{title:"SessionPage",text:"This page is being built."})}export{o as SessionPage};
